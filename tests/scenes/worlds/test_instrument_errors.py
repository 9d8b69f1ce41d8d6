"""Tests of worlds whose position instrument has a bias and a drift: fits eliminate them, only readings contain them."""

import json
import random
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import physment_mcp
from evaluator.answers.engine import all_readings
from evaluator.certify.lint import lint
from evaluator.certify.worlds import Made, course_gap, fault_of, make_world
from evaluator.commands.program import main
from evaluator.records.episode import Verdict
from evaluator.store.run_folder import RunFolder
from physment_mcp.scene import load_scene
from physment_mcp.serving.views import view_of
from physment_mcp.session import Session
from physment_mcp.visibility import cached_visibility
from scenes.errors import WorldError
from scenes.worlds.acceptance import bounds_of
from scenes.worlds.drawing import draw_constants
from scenes.worlds.expansion import expand
from scenes.worlds.experiment import Situation, simulated
from scenes.worlds.instrument_errors import draw_errors, error_columns, kinematic_errors, whitened
from scenes.worlds.levels import GRAMMAR, difficulty_of
from scenes.worlds.orders import PUBLIC
from scenes.worlds.parts import Apparatus
from scenes.worlds.questions import Question
from scenes.worlds.records import Certificate, WorldRecord, as_line, keys_file, lines_file, read_records
from scenes.worlds.refits import Refits, units_of
from scenes.worlds.rivals import removable
from scenes.worlds.task_reading import situation_of
from scenes.worlds.terms import Structure, Term
from scenes.worlds.weak_form import Legs
from tests.harness.fuzz.leaks import published

BIAS, DRIFT = 1.0, 0.1
STRUCTURES = {
    Apparatus.WHEEL: Structure(Apparatus.WHEEL, (Term("friction"), Term("swinger"))),
    Apparatus.GLIDER: Structure(Apparatus.GLIDER, (Term("friction", ("wear",)), Term("slope"))),
    Apparatus.PUCK: Structure(Apparatus.PUCK, (Term("linear drag"), Term("responder"))),
    Apparatus.PAIR: Structure(Apparatus.PAIR, (Term("linear drag"), Term("wake"), Term("mutual spring"))),
}


def told_of(structure: Structure, bias: float = BIAS, drift: float = DRIFT, looks: int = 30) -> Situation:
    return Situation(structure.apparatus, structure.radius, 5.0, looks, 0.004, bias, drift)


def record_of(structure: Structure, told: Situation, seed: int = 1, **errors: float) -> WorldRecord:
    """Return a world with the constants of a seed, and with its errors unless others are given."""
    rng = random.Random(seed)
    constants = draw_constants(structure, rng)
    if told.errors:
        constants |= draw_errors(told.width, told.bias, told.drift, rng) | errors
    nothing = (0.0,) * structure.controls
    asked = Question("strong", nothing, nothing, (9.0, 0.0, 0.0, 0.0)[: len(nothing)], 0.0, 1.5, "u")
    if structure.apparatus.flat:
        asked = replace(asked, what="vx")
    return WorldRecord(
        grammar=GRAMMAR, level=5, index=0, split="train", salt="s", apparatus=structure.apparatus,
        terms=tuple((term.form, term.modulations) for term in structure.terms), constants=constants,
        radius=told.radius, force=told.force, looks=told.looks, noise=told.noise, bias=told.bias, drift=told.drift,
        questions=(asked,) * 3,
    )  # fmt: skip


@pytest.fixture(scope="module")
def made() -> Made:
    """A world of a low level with both attributes."""
    return make_world(1, difficulty_of(1).changed(bias=BIAS, drift=DRIFT), PUBLIC, 0)


def test_whitened_misfits_have_the_least_sum_of_squares_of_misfits_and_errors() -> None:
    rng = np.random.default_rng(1)
    misfits, spread = rng.normal(size=(40, 3)), 30 * rng.normal(size=(40, 4))
    found = (whitened(misfits, spread) ** 2).sum(axis=0)
    rows = np.vstack([spread, np.eye(4)])
    for trial, own in zip(found, misfits.T, strict=True):
        wanted = np.linalg.lstsq(rows, np.concatenate([own, np.zeros(4)]), rcond=None)[1][0]
        assert trial == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize("structure", STRUCTURES.values(), ids=STRUCTURES)
def test_the_error_follows_from_the_readings_without_the_law(structure: Structure) -> None:
    record = record_of(structure, told_of(structure, looks=40))
    told = record.told
    course = simulated(structure, record.constants, told, 3)
    times = np.cumsum(course.durations)
    path = np.vstack([np.array(structure.start)[: structure.read], course.readings])
    nodes = path.reshape(len(path), -1, 2, told.width)
    columns = error_columns(times, told.bodies, told.width).reshape(len(times), -1, 2, told.width, 2 * told.width)
    found = kinematic_errors(
        nodes[:, :, 0].reshape(len(path), -1), nodes[:, :, 1].reshape(len(path), -1), course.durations,
        columns[:, :, 0].reshape(len(times), -1, 2 * told.width),
    )  # fmt: skip
    true = [record.constants[name] for name in told.errors]
    assert found[: told.width] == pytest.approx(true[: told.width], abs=0.2)
    assert found[told.width :] == pytest.approx(true[told.width :], abs=0.04)


@pytest.mark.parametrize("structure", STRUCTURES.values(), ids=STRUCTURES)
def test_legs_of_the_true_law_leave_the_noise(structure: Structure) -> None:
    record = record_of(structure, told_of(structure), seed=2)
    course = simulated(structure, record.constants, record.told, 3)
    unit, legs = units_of(structure, record.constants), Legs.of(course, record.told)
    for _ in range(3):
        legs = legs.about(structure, unit).smoothed(structure, unit)
    misfits = legs.about(structure, unit).misfits(structure, unit[:, None])[: course.count, 0]
    assert abs(float(misfits @ misfits) - course.count) / np.sqrt(2 * course.count) < 4
    true = course.readings - record.told.errors_at(record.constants, np.cumsum(course.durations))
    off = np.abs(legs.path[1:] - true) / record.told.sigma
    assert float(np.sqrt((off**2).mean())) < 4  # the readings themselves deviate by more than 100


@pytest.mark.parametrize("structure", STRUCTURES.values(), ids=STRUCTURES)
def test_the_engine_reads_what_the_theory_says(structure: Structure, tmp_path: Path) -> None:
    record = record_of(structure, told_of(structure, looks=12))
    assert course_gap(record) < 0.01
    expand(record, tmp_path)
    episode = physment_mcp.open_episode(record.scene_id, 0, scenes_dir=tmp_path)
    plain = record.model_copy(
        update={"bias": 0.0, "drift": 0.0, "constants": draw_constants(structure, random.Random(1))}
    )
    expand(plain, tmp_path / "plain")
    without = physment_mcp.open_episode(record.scene_id, 0, scenes_dir=tmp_path / "plain")
    name = "angle" if record.apparatus is Apparatus.WHEEL else "position"
    for time, lasting in ((0.0, 0.0), (0.45, 0.45), (3.15, 2.7)):
        for one in (episode, without) if lasting else ():
            one.call("step", duration=lasting)
        read = [np.atleast_1d(one.call("get_position", object_id="object_1")[name]) for one in (episode, without)]
        error = record.told.errors_at(record.constants, np.array([time]))[0][: record.told.width]
        assert (read[0] - read[1])[: record.told.width] == pytest.approx(error, abs=0.0011)
        same = [one.call("get_velocity", object_id="object_1") for one in (episode, without)]
        assert same[0] == same[1]


@pytest.mark.parametrize(("bias", "drift"), [(BIAS, DRIFT), (0.25, 0.0), (0.0, 0.015)])
@pytest.mark.parametrize("apparatus", Apparatus)
def test_the_prompt_admits_the_bounds_and_nothing_else(
    apparatus: Apparatus, bias: float, drift: float, tmp_path: Path
) -> None:
    structure = STRUCTURES[apparatus]
    sentences: list[str] = []
    for seed in (1, 2):
        record = record_of(structure, told_of(structure, bias, drift), seed)
        expand(record, tmp_path / f"{seed}")
        prompt = physment_mcp.open_episode(record.scene_id, 0, scenes_dir=tmp_path / f"{seed}").prompt
        told = situation_of(prompt)
        assert (told.bias, told.drift) == (bias, drift)
        sentences += [line for line in prompt.splitlines() if "also adds an error" in line]
    assert len(sentences) == 2
    assert len(set(sentences)) == 1


def test_an_accepted_world_is_proved_and_needs_the_error_in_the_fit(made: Made, tmp_path: Path) -> None:
    record, certificate = made.record, made.certificate
    assert fault_of(record, certificate) is None
    assert record.settings == ("bias=1.0", "drift=0.1")
    assert all(abs(record.constants[name]) >= 0.05 for name in record.told.errors)
    lines_file(tmp_path, 1).write_text(as_line(record) + "\n", encoding="utf-8")
    assert list(read_records(tmp_path, 1)) == [record]
    course = simulated(record.structure, record.constants, record.told, 1)
    refits = Refits(record.structure, record.constants, record.told, course)
    key = np.array(certificate.key)
    assert not removable(refits, record.questions, key)
    moved = record.constants | {record.told.errors[0]: 0.0}
    assert fault_of(record.model_copy(update={"constants": moved}), certificate) is not None


def test_unknown_errors_raise_the_bounds_of_the_answers(made: Made) -> None:
    record = made.record
    known = replace(record.told, bias=1e-9, drift=1e-9)  # within these limits, the fit has no errors to find
    at = [bounds_of(record.structure, record.constants, told, record.questions) for told in (known, record.told)]
    assert all(less <= more for less, more in zip(*at, strict=True))
    assert max(at[1]) > max(at[0])


def test_the_reference_solves_a_world_through_the_tools(
    made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    worlds = tmp_path / "worlds"
    worlds.mkdir()
    lines_file(worlds, 1).write_text(as_line(made.record) + "\n", encoding="utf-8")
    keys_file(worlds, 1).write_text(as_line(made.certificate) + "\n", encoding="utf-8")
    run = ["run", "--server", "host", "--agent", "reference", "--scenes", "world:1:0", "--scenes-dir", str(worlds)]
    assert main([*run, "--out", str(tmp_path / "run")]) == 0
    (record,) = RunFolder(tmp_path / "run").grades().values()
    assert record.grade.strict is Verdict.CORRECT
    capsys.readouterr()
    assert main(["worlds", "show", "1:0", "--worlds-dir", str(worlds), "--private"]) == 0
    shown = capsys.readouterr().out
    assert "a bias of at most 1 and a drift of at most 0.1 per second" in shown
    assert str(made.record.constants[made.record.told.errors[0]]) in shown


async def test_nothing_but_readings_of_positions_depends_on_the_error(tmp_path: Path) -> None:
    structure, found = STRUCTURES[Apparatus.PUCK], list[dict[str, Any]]()
    for drift in (0.06, -0.09):
        record = record_of(structure, told_of(structure), instrument_drift_x=drift)
        certificate = Certificate(index=0, record=record.digest, key=(1.0,) * 3, bounds=(0.1,) * 3)
        expand(record, tmp_path / f"{drift}", certificate)
        session = Session(load_scene(record.scene_id, 0, tmp_path / f"{drift}"))
        found.append(await published(session) | dict(await all_readings(session)))
        view = view_of(session, cached_visibility(tmp_path / f"{drift}")(session.scene))
        episode = physment_mcp.open_episode(record.scene_id, 0, scenes_dir=tmp_path / f"{drift}")
        assert view["poses"]["object_1"][:3] == episode.call("get_position", object_id="object_1")["position"]
        secrets = [f"{record.constants[name]:.4g}" for name in record.told.errors]
        seen = json.dumps([found[-1], view], default=str)
        assert [secret for secret in (*secrets, "systematic", "instrument_") if secret in seen] == []
    assert found[0] == found[1]  # a drift makes no difference at the start


@pytest.mark.parametrize(
    ("attribute", "sentence"),
    [("bias=3", "bias must be from 0 to 2, not 3"), ("drift=-0.1", "drift must be from 0 to 0.2, not -0.1"),
     ("bias=nan", "bias must be from 0 to 2, not nan"), ("drift=fast", "drift=fast: write NAME=VALUE")],
)  # fmt: skip
def test_an_attribute_out_of_range_is_refused_in_a_sentence(
    attribute: str, sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["worlds", "make", "--level", "1", "--out", str(tmp_path / "w"), "--set", attribute]) == 2
    errors = capsys.readouterr().err
    assert sentence in errors
    assert errors.count("\n") == 1


@pytest.mark.parametrize(
    ("change", "sentence"),
    [({"bias": 0.2}, "an error of the position instrument is larger than the prompt admits"),
     ({"bias": 0, "drift": 0}, "the constants are not those of the terms"),
     ({"drift": -1}, "drift: Input should be greater than or equal to 0")],
)  # fmt: skip
def test_a_record_with_other_errors_than_it_admits_is_refused(
    change: dict[str, float], sentence: str, tmp_path: Path
) -> None:
    structure = STRUCTURES[Apparatus.WHEEL]
    line = json.loads(as_line(record_of(structure, told_of(structure)))) | change
    lines_file(tmp_path, 5).write_text(json.dumps(line) + "\n", encoding="utf-8")
    with pytest.raises(WorldError, match=sentence):
        list(read_records(tmp_path, 5))


def test_worlds_without_the_attributes_have_their_records_as_before() -> None:
    structure = STRUCTURES[Apparatus.PUCK]
    line = as_line(record_of(structure, told_of(structure, 0.0, 0.0)))
    assert not {"bias", "drift"} & json.loads(line).keys()
    assert "instrument" not in line


def test_lint_demands_that_nothing_is_put_relative_to_a_wrong_position(tmp_path: Path) -> None:
    structure = STRUCTURES[Apparatus.PUCK]
    record = record_of(structure, told_of(structure))
    certificate = Certificate(index=0, record=record.digest, key=(1.0,) * 3, bounds=(0.1,) * 3)
    files = expand(record, tmp_path, certificate)
    assert not [fault for fault in lint(files) if "systematic error" in fault]
    pack = json.loads(files.json.read_text(encoding="utf-8"))
    del pack["disabled_tools"]["move_object"]
    files.json.write_text(json.dumps(pack), encoding="utf-8")
    assert [fault for fault in lint(files) if fault.startswith("disable move_object: ")]
