"""Tests of measured evidence against closed forms: a known force drives a puck of unknown mass along a rail."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import anyio
import numpy as np
import pytest

from evaluator.certify.constants import Constants
from evaluator.certify.evidence import measured
from evaluator.certify.information import information
from evaluator.certify.subject import Subject
from evaluator.certify.verify import MemoryConnector, play_reference
from evaluator.records.episode import Episode, Verdict
from evaluator.records.evidence import EvidenceRecord, EvidenceVerdict, evidence_verdict
from scenes import find_pack

SEED, NOISE, RESOLUTION = 3, 0.05, 0.01
LOW, HIGH = 1.0, 3.0
XML = """<mujoco><option timestep="0.005" gravity="0 0 0"/><worldbody>
<body name="object_1"><joint name="rail" type="slide" axis="1 0 0"/>
<inertial mass="2.0" pos="0 0 0" diaginertia="1 1 1"/>
<geom type="sphere" size="0.1" contype="0" conaffinity="0"/></body>
</worldbody></mujoco>"""
PUSH = 'call("apply_force", object_id="object_1", force_vector=[2, 0, 0]), call("step", duration=1.0)'
LOOK = 'call("get_velocity", object_id="object_1")'
Measure = Callable[..., tuple[EvidenceRecord, float]]
Ridge = Callable[..., tuple[Subject, Episode]]


def written(folder: Path, calls: str, knobs: dict[str, object], theory: str, answer: object, kind: str) -> None:
    place = folder / "Scene900"
    place.mkdir()
    options = {"options": ["light", "heavy"]} if kind == "choice" else {"unit": "kg"}
    pack = {
        "metadata": {"scene_name": "Puck", "task": "Which mass, in kg?", "problem_type": "computation"},
        "answer": answer,
        "objects": {"object_1": {"name": "puck", "object_id": "1"}},
        "object_permissions": {"object_1_permissions": {"body_pos": True}},
        "category": "easy-single",
        "answer_spec": {"kind": kind, **options},
        "knobs": knobs,
        "apply": {"body[object_1]/inertial.mass": "m"},
        "instruments": {"velocity": RESOLUTION, "noise": {"velocity": NOISE, "position": 10.0}},
    }
    (place / "scene900.json").write_text(json.dumps(pack))
    (place / "scene900.xml").write_text(XML)
    (place / "solution.py").write_text(
        "from scenes.protocol import answer, call\n\n\ndef theory(knobs):\n"
        f"    return {theory}\n\n\ndef solve(task):\n    yield [{calls}]\n    yield [answer({answer!r})]\n"
    )


@pytest.fixture
def played(tmp_path: Path) -> Callable[..., tuple[Subject, Episode]]:
    """Plays a list of calls in the scene."""

    def play(
        calls: str,
        knobs: dict[str, object] | None = None,
        theory: str = "knobs['m']",
        answer: object = 2.0,
        kind: str = "number",
    ) -> tuple[Subject, Episode]:
        written(tmp_path, calls, knobs or {"m": {"canonical": 2.0, "uniform": [LOW, HIGH]}}, theory, answer, kind)
        subject = Subject.open(find_pack(900, tmp_path))
        return subject, anyio.run(play_reference, subject, SEED, MemoryConnector(tmp_path))

    return play


def bound(mass: float, times: list[float]) -> float:
    """Return the bound on the standard error of the mass, over its tolerance, from readings of v = 2 N · t / m."""
    sigma = np.hypot(NOISE, RESOLUTION / np.sqrt(12))
    slopes = np.array([2 * time / mass**2 for time in times]) * (HIGH - LOW) / sigma
    return float((HIGH - LOW) / np.sqrt(12 + slopes @ slopes) / (0.05 * mass))


def test_the_bound_of_a_velocity_is_the_closed_form(played: Callable[..., tuple[Subject, Episode]]) -> None:
    subject, episode = played(f"{PUSH}, {LOOK}")
    found = measured(subject, SEED, episode, "")
    mass = float(str(subject.draw(SEED).knobs["m"]))
    assert found.not_measurable == ""
    assert [step.call for step in found.calls] == [3]
    assert found.calls[-1].bounds[0] == pytest.approx(bound(mass, [1.0]), rel=1e-3)
    information = 12 * (HIGH - LOW) ** -2 * (bound(mass, [1.0]) * 0.05 * mass) ** 2
    assert found.calls[-1].bits == pytest.approx(-0.5 * np.log2(information), abs=0.01)


@pytest.mark.parametrize(
    "again",
    [
        LOOK,
        'call("get_momentum", object_id="object_1", mass=1.0)',
        'call("get_kinetic_energy", object_id="object_1", mass=1.0)',
    ],
)
def test_a_second_reading_of_one_error_tells_nothing_new(
    played: Callable[..., tuple[Subject, Episode]], again: str
) -> None:
    subject, episode = played(f"{PUSH}, {LOOK}, {again}")
    first, second = measured(subject, SEED, episode, "").calls
    assert second.bounds[0] == pytest.approx(first.bounds[0], rel=1e-3)


def test_readings_at_other_moments_add_their_information(played: Callable[..., tuple[Subject, Episode]]) -> None:
    subject, episode = played(f'{PUSH}, {LOOK}, call("step", duration=1.0), {LOOK}')
    mass = float(str(subject.draw(SEED).knobs["m"]))
    assert measured(subject, SEED, episode, "").calls[-1].bounds[0] == pytest.approx(bound(mass, [1.0, 2.0]), rel=1e-3)


def test_an_energy_that_is_computed_from_a_velocity_tells_what_the_velocity_tells(
    played: Callable[..., tuple[Subject, Episode]],
) -> None:
    subject, episode = played(f'{PUSH}, call("get_kinetic_energy", object_id="object_1", mass=1.0)')
    mass = float(str(subject.draw(SEED).knobs["m"]))
    assert measured(subject, SEED, episode, "").calls[-1].bounds[0] == pytest.approx(bound(mass, [1.0]), rel=1e-3)


def test_an_episode_without_readings_leaves_what_the_ranges_leave(
    played: Callable[..., tuple[Subject, Episode]],
) -> None:
    subject, episode = played('call("step", duration=1.0)')
    found = measured(subject, SEED, episode, "")
    assert not found.calls
    assert not found.suffices
    assert evidence_verdict(found, Verdict.CORRECT) is EvidenceVerdict.GUESSED
    assert evidence_verdict(found, Verdict.INCORRECT) is EvidenceVerdict.EXPERIMENT_INSUFFICIENT


def test_a_long_push_suffices_and_the_verdict_follows_from_the_grade(
    played: Callable[..., tuple[Subject, Episode]],
) -> None:
    subject, episode = played(f'{PUSH}, {LOOK}, call("step", duration=30.0), {LOOK}')
    found = measured(subject, SEED, episode, "")
    assert found.sufficed_at == 5
    assert evidence_verdict(found, Verdict.CORRECT) is EvidenceVerdict.EARNED
    assert evidence_verdict(found, Verdict.INCORRECT) is EvidenceVerdict.INFERENCE_FAILED
    assert evidence_verdict(found, Verdict.UNSCORED) is None


DISCRETE = {"m": {"canonical": 2.0, "choice": [1.0, 2.0]}}


@pytest.mark.parametrize(("calls", "open_rivals"), [("", 1), (f"{PUSH}, {LOOK}", 0)])
def test_a_discrete_value_is_a_rival_until_a_reading_excludes_it(
    played: Callable[..., tuple[Subject, Episode]], calls: str, open_rivals: int
) -> None:
    before = 'call("get_velocity", object_id="object_1"), '
    word = "'light' if knobs['m'] < 1.5 else 'heavy'"
    subject, episode = played(before + calls, DISCRETE, word, "heavy", "choice")
    last = measured(subject, SEED, episode, "").calls[-1]
    assert last.rivals == open_rivals
    assert last.suffices == (open_rivals == 0)


@pytest.mark.parametrize("scene", [14, 70])
def test_a_constant_without_effect_at_other_discrete_values_does_not_explain_the_readings(scene: int) -> None:
    # At the sampled values, a factor distinguishes one of two objects. At the rival's values, both are always equal.
    subject = Subject.open(find_pack(scene))
    episode = anyio.run(play_reference, subject, 0, MemoryConnector())
    found = measured(subject, 0, episode, "0" * 64)
    assert [rival.name for rival in found.rivals if not rival.excluded] == []
    assert found.calls[-1].suffices


def test_a_choice_has_the_probability_that_plausible_constants_give_it(
    played: Callable[..., tuple[Subject, Episode]],
) -> None:
    word = "'light' if knobs['m'] < 2 else 'heavy'"
    subject, episode = played(f'{LOOK}, {PUSH}, call("step", duration=30.0), {LOOK}', None, word, "heavy", "choice")
    blind, seen = (step.choice for step in measured(subject, SEED, episode, "").calls)
    assert blind is not None
    assert seen is not None
    assert blind < 0.95 < seen


def test_a_record_that_somebody_edited_is_not_measured(played: Callable[..., tuple[Subject, Episode]]) -> None:
    subject, episode = played(f"{PUSH}, {LOOK}")
    text = episode.model_dump_json().replace('"velocity":[', '"velocity":[9', 1)
    found = measured(subject, SEED, Episode.model_validate_json(text), "")
    assert "call 3 of the record is not what the laboratory returns" in found.not_measurable
    assert evidence_verdict(found, Verdict.CORRECT) is None


def test_a_pack_without_hidden_values_is_not_measured(played: Callable[..., tuple[Subject, Episode]]) -> None:
    subject, episode = played(LOOK)
    bare = Subject(subject.files, subject.pack.model_copy(update={"knobs": {}}), subject.solution, subject.spec)
    assert measured(bare, SEED, episode, "").not_measurable == "the pack draws no hidden values"


def test_what_is_revealed_is_read_with_the_errors_of_the_instruments(tmp_path: Path) -> None:
    """`find_objects` returns a position as precisely as `get_position`; a second reading adds nothing."""
    calls = 'call("find_objects"), call("get_position", object_id="object_2")'
    written(tmp_path, calls, {"m": {"canonical": 2.0, "uniform": [LOW, HIGH]}}, "knobs['m']", 2.0, "number")
    place = tmp_path / "Scene900"
    hidden = '<body name="object_2" pos="2 0 0"><geom size="0.1" contype="0" conaffinity="0"/></body>'
    (place / "scene900.xml").write_text(XML.replace("</worldbody>", f"{hidden}</worldbody>"))
    pack = json.loads((place / "scene900.json").read_text())
    pack["objects"]["object_2"] = {"name": "post", "object_id": "2"}
    pack["object_permissions"]["object_2_permissions"] = {"body_pos": True, "hidden": True}
    pack["apply"] = {"body[object_2].pos": ["m", 0, 0]}
    pack["instruments"] = {"noise": {"position": NOISE}}
    (place / "scene900.json").write_text(json.dumps(pack))
    subject = Subject.open(find_pack(900, tmp_path))
    episode = anyio.run(play_reference, subject, SEED, MemoryConnector(tmp_path))
    found, again = measured(subject, SEED, episode, "").calls
    mass = float(str(subject.draw(SEED).knobs["m"]))
    share = NOISE / (HIGH - LOW)
    assert found.bounds[0] == pytest.approx((HIGH - LOW) / np.sqrt(12 + share**-2) / (0.05 * mass), rel=1e-3)
    assert again.bounds[0] == pytest.approx(found.bounds[0], rel=1e-3)


def test_a_theory_that_fails_beside_the_drawn_values_leaves_the_episode_unmeasured(
    played: Callable[..., tuple[Subject, Episode]],
) -> None:
    subject, episode = played(f"{PUSH}, {LOOK}")
    drawn = subject.draw(SEED).knobs["m"]
    solution = replace(subject.solution, theory=lambda knobs: 1 / (knobs["m"] == drawn))
    broken = Subject(subject.files, subject.pack, solution, subject.spec)
    assert "cannot be computed beside the drawn values" in measured(broken, SEED, episode, "").not_measurable


@pytest.fixture
def ridge(tmp_path: Path) -> Ridge:
    """Plays readings of a puck on an unstable equilibrium; the growth rate is 1/s and stops limit it to ±1 m.

    The equilibrium is at `top`, or at "top + side / 2".
    """

    def play(waits: list[float], place_of: str = "top") -> tuple[Subject, Episode]:
        look = 'call("get_position", object_id="object_1")'
        waiting = "".join(f', call("step", duration={wait}), {look}' for wait in waits)
        named = ("top", "side") if "side" in place_of else ("top",)
        knobs: dict[str, object] = {name: {"canonical": 0.0, "uniform": [-1.0, 1.0]} for name in named}
        balance = 'call("apply_force", object_id="object_1", force_vector=[TOP, 0, 0])'
        written(tmp_path, balance + waiting, knobs, "knobs['top'] + 3", 3.0, "number")
        place = tmp_path / "Scene900"
        rail = '<joint name="rail" type="slide" axis="1 0 0" stiffness="-1" range="-1 1" limited="true"/>'
        xml = XML.replace('<joint name="rail" type="slide" axis="1 0 0"/>', rail).replace('mass="2.0"', 'mass="1.0"')
        (place / "scene900.xml").write_text(xml)
        pack = json.loads((place / "scene900.json").read_text())
        pack["apply"] = {"joint[rail].springref": place_of}
        pack["instruments"] = {"noise": {"position": RIDGE_NOISE}}
        (place / "scene900.json").write_text(json.dumps(pack))
        drawn = {
            name: float(str(value)) for name, value in Subject.open(find_pack(900, tmp_path)).draw(SEED).knobs.items()
        }
        solution = place / "solution.py"
        solution.write_text(solution.read_text().replace("TOP", repr(drawn["top"] + drawn.get("side", 0.0) / 2)))
        subject = Subject.open(find_pack(900, tmp_path))
        return subject, anyio.run(play_reference, subject, SEED, MemoryConnector(tmp_path))

    return play


RIDGE_NOISE = 0.01


def test_a_reading_beyond_the_horizon_of_unstable_motion_does_not_count(
    ridge: Ridge,
) -> None:
    """After 20 s, a shift by 1e-4 of the range drives the puck to a stop: both one-sided derivatives are 1e4 m."""
    subject, episode = ridge([2.0, 18.0])
    early, late = measured(subject, SEED, episode, "").calls
    tolerance = 0.05 * (float(str(subject.draw(SEED).knobs["top"])) + 3)
    expected = 2 / np.sqrt(12 + (2 * (np.cosh(2.0) - 1) / RIDGE_NOISE) ** 2) / tolerance
    assert early.bounds[0] == pytest.approx(expected, rel=0.02)
    assert late.bounds == early.bounds


def test_an_episode_that_only_such_a_reading_would_decide_is_not_measured(
    ridge: Ridge,
) -> None:
    subject, episode = ridge([20.0])
    found = measured(subject, SEED, episode, "")
    assert "not linear in the hidden values" in found.not_measurable


@pytest.mark.parametrize("wait", [9.0, 18.0])
def test_curvature_over_the_step_of_a_derivative_does_not_distinguish_constants(ridge: Ridge, wait: float) -> None:
    """Only a sum of two constants has an effect. A shift of 1e-4, or of 1e-6, of a range drives the puck to an end."""
    subject, episode = ridge([2.0, wait], "top + side / 2")
    constants = Constants.of(subject, SEED)
    told = information(constants, episode)
    (found,) = constants.bounds(told.fisher(range(len(told.calls))))
    tolerance = 0.05 * (float(str(subject.draw(SEED).knobs["top"])) + 3)
    assert found == pytest.approx(2 / np.sqrt(12) / np.sqrt(1 + 2**2) / tolerance, rel=0.01)


def test_a_step_at_the_edge_of_a_range_is_shortened_and_not_turned(
    played: Callable[..., tuple[Subject, Episode]],
) -> None:
    knobs: dict[str, object] = {
        "m": {"canonical": 2.0, "uniform": [LOW, HIGH]},
        "k": {"canonical": 2.0, "uniform": [LOW, HIGH]},
    }
    subject, _ = played(LOOK, knobs)
    found = Constants(subject, {"m": 2.0, "k": HIGH - 0.2}, ("m", "k"))
    assert found.shortened(np.array([0.3, 0.2])) == pytest.approx({"m": 0.15, "k": 0.1})
    assert found.shortened(np.array([-0.3, -0.2])) == pytest.approx({"m": -0.3, "k": -0.2})
