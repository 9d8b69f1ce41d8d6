"""Tests of the `solution.py` of worlds against closed forms: a puck of unknown mass under linear drag."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import anyio
import numpy as np
import pytest

from evaluator.certify.evidence import measured
from evaluator.certify.probing import Replay
from evaluator.certify.subject import Subject
from evaluator.certify.verify import MemoryConnector, play_reference
from evaluator.records.episode import Episode
from evaluator.records.evidence import EvidenceRecord
from scenes import find_pack
from scenes.course_record import Course
from scenes.fitting import Array
from scenes.protocol import Call, Exchanges, Reading, call
from scenes.worlds.answering import answers
from scenes.worlds.expansion import expand
from scenes.worlds.experiment import RESOLUTION
from scenes.worlds.levels import GRAMMAR
from scenes.worlds.parts import Apparatus
from scenes.worlds.questions import ABS_TOL, REL_TOL, Question
from scenes.worlds.records import Certificate, WorldRecord
from scenes.worlds.reference import WorldSolution, course_of
from scenes.worlds.refits import Refits
from scenes.worlds.weak_form import named

MASS, DRAG, PUSH, NOISE = 1.2, 0.5, 3.0, 0.01
TIMES, HARD, LATE = (0.8, 2.0), 9.0, 2.0
RANGES = np.log([2.0 / 0.8, 1.0 / 0.3])
"""Logarithms of the ranges of mass and drag."""
ASKED = Question("strong", (0.0, 0.0), (0.0, 0.0), (HARD, 0.0), 0.0, LATE, "vx")


def record_of(apparatus: Apparatus = Apparatus.PUCK, **changed: object) -> WorldRecord:
    return WorldRecord.model_validate(
        {
            "grammar": GRAMMAR, "level": 1, "index": 7, "split": "test", "salt": "s", "apparatus": apparatus,
            "terms": (("linear drag", ()),), "constants": {"m": MASS, "c0": DRAG}, "radius": 6.0, "force": 5.0,
            "looks": 40, "noise": NOISE, "questions": (ASKED,), **changed,
        }
    )  # fmt: skip


def speed(push: float, times: Array, mass: float = MASS, drag: float = DRAG) -> Array:
    """Return the velocity of a puck that a constant force drives from rest: F / (m c) (1 - exp(-c t))."""
    return push / (mass * drag) * (1 - np.exp(-drag * times))


def slopes(push: float, times: Array) -> Array:
    """Return the derivatives of `speed` with respect to mass and drag, in units of their logarithmic ranges."""
    value = speed(push, times)
    by_drag = push / (MASS * DRAG) * times * np.exp(-DRAG * times) - value / DRAG
    return np.column_stack([-value, DRAG * by_drag]) * RANGES


def closed_form_bound(prior: float) -> float:
    """Return the bound of the asked velocity after readings of the velocity at `TIMES`, in tolerances."""
    read = slopes(PUSH, np.array(TIMES)) / np.hypot(2 * NOISE, RESOLUTION / np.sqrt(12))
    (asked,) = slopes(HARD, np.array([LATE]))
    (value,) = speed(HARD, np.array([LATE]))
    variance = asked @ np.linalg.inv(prior * np.eye(2) + read.T @ read) @ asked
    return float(np.sqrt(variance) / (ABS_TOL + REL_TOL * value))


CALLS = (
    call("apply_force", object_id="object_1", force_vector=[PUSH, 0.0, 0.0]),
    call("step", duration=TIMES[0]),
    call("get_velocity", object_id="object_1"),
    call("step", duration=TIMES[1] - TIMES[0]),
    call("get_velocity", object_id="object_1"),
)


def played(
    record: WorldRecord, folder: Path, calls: Sequence[Call] = CALLS, rivals: bool = True
) -> tuple[Subject, Episode]:
    """Play a list of calls in a world, whose solution fits other laws or not."""
    key = tuple(answers(record.structure, record.constants, record.questions, 0.01)[:, 0])
    files = expand(record, folder, Certificate(index=record.index, record=record.digest, key=key, bounds=(0.1,)))
    with files.solution.open("a", encoding="utf-8") as solution:
        made = ", ".join(f"call({one.tool!r}, **{one.arguments!r})" for one in calls)
        names = ("theory", "structure", "generated", *(["rivals"] if rivals else ()))
        solution.write(f"{', '.join(names)} = {', '.join(f'solve.{name}' for name in names)}\n")
        solution.write("\nfrom scenes.protocol import answer, call\n")
        solution.write(f"\n\ndef solve(task):\n    yield [{made}]\n    yield [answer([1.0])]\n")
    subject = Subject.open(find_pack(record.scene_id, folder))
    return subject, anyio.run(play_reference, subject, 0, MemoryConnector(folder))


def test_the_bound_in_a_world_is_the_closed_form(tmp_path: Path) -> None:
    subject, episode = played(record_of(), tmp_path, rivals=False)
    found = measured(subject, 0, episode, "")
    assert found.not_measurable == ""
    assert [step.call for step in found.calls] == [3, 5]
    assert found.calls[-1].bounds[0] == pytest.approx(closed_form_bound(12.0), rel=2e-3)


def test_a_reading_that_was_not_made_contains_no_information() -> None:
    record = record_of()
    told, at = record.told, np.array(TIMES)
    seen = np.full((2, 4), np.nan)
    seen[:, 2:] = np.column_stack([speed(PUSH, at), np.zeros(2)])
    course = Course(np.diff([0.0, *TIMES]), np.tile([PUSH, 0.0], (2, 1)), seen)
    fit = Refits(record.structure, record.constants, told, course).drawn
    shift = 1e-4
    around = np.column_stack([fit.unit, *(fit.unit + shift * np.eye(2))])
    found = answers(fit.structure, named(fit.structure, around), [ASKED], 0.01)[0]
    gradient = (found[1:] - found[0]) / shift
    # The regularisation of the fit has the weight 0.3 in its own units, which are 1.56 and 1.37 times as large.
    variance = gradient @ np.linalg.inv(fit.slope.T @ fit.slope) @ gradient
    assert np.sqrt(variance) / (ABS_TOL + REL_TOL * found[0]) == pytest.approx(closed_form_bound(0.05), rel=0.02)


def test_the_error_of_an_instrument_is_a_constant_with_the_stated_range(tmp_path: Path) -> None:
    errors = {
        "instrument_bias_x": 0.04,
        "instrument_bias_y": -0.05,
        "instrument_drift_x": 0.0,
        "instrument_drift_y": 0.0,
    }
    record = record_of(constants={"m": MASS, "c0": DRAG, **errors}, bias=0.06, drift=0.01)
    look = call("get_position", object_id="object_1")
    subject, episode = played(record, tmp_path, [call("step", duration=1.0), look], rivals=False)
    knobs = subject.knobs
    assert knobs["instrument_bias_x"].uniform == (-0.06, 0.06)
    assert knobs["instrument_drift_y"].uniform == (-0.01, 0.01)
    values = {name: knob.canonical for name, knob in knobs.items()}
    read = Replay(subject.files, subject.mjcf(values | {"instrument_bias_x": 0.01})).read(0, *_of(look), slopes=False)
    assert read is not None
    assert read.values[:2] == pytest.approx([0.01, -0.05])
    assert not measured(subject, 0, episode, "").suffices


def _of(one: Call) -> tuple[str, Mapping[str, object]]:
    return one.tool, one.arguments


def test_an_error_with_the_bound_0_is_no_hidden_constant(tmp_path: Path) -> None:
    errors = dict.fromkeys(("instrument_bias_y", "instrument_drift_x", "instrument_drift_y"), 0.0)
    record = record_of(constants={"m": MASS, "c0": DRAG, "instrument_bias_x": 0.04, **errors}, bias=0.06)
    subject, episode = played(record, tmp_path, rivals=False)
    assert set(subject.knobs) == {"m", "c0", "instrument_bias_x", "instrument_bias_y"}
    assert measured(subject, 0, episode, "").not_measurable == ""


def test_an_agent_may_write_the_number_of_an_object(tmp_path: Path) -> None:
    short = [
        Call(one.tool, one.arguments | ({"object_id": "1"} if "object_id" in one.arguments else {})) for one in CALLS
    ]
    (subject, episode), (_, other) = (
        played(record_of(), tmp_path / str(n), made) for n, made in enumerate((CALLS, short))
    )
    assert measured(subject, 0, other, "").rivals == measured(subject, 0, episode, "").rivals


def exchanges_of(*made: tuple[Call, Reading]) -> Exchanges:
    return made


def test_the_course_of_an_episode_has_the_steps_of_the_engine() -> None:
    push, look = CALLS[0], CALLS[2]
    velocity = {"velocity": [1.0, 2.0, 0.0], "sim_time": 0.335}
    course = course_of(
        record_of().told,
        exchanges_of(
            (look, {"velocity": [9.0, 9.0, 9.0], "sim_time": 0.0}),
            (push, {"status": "set", "sim_time": 0.0}),
            (call("step", duration=0.333), {"steps": 67, "sim_time": 0.335}),
            (look, velocity),
            (call("step", duration=-1.0), {"error": "no"}),
            (call("apply_force", object_id="object_1", force_vector=[0.0, 1.0, 7.0]), {"error": "too large"}),
            (call("step", duration=1.0), {"steps": 200, "sim_time": 1.335}),
        ),
    )
    assert course.durations == pytest.approx([0.335, 1 / 3, 1 / 3, 1 / 3])
    assert course.controls == pytest.approx(np.tile([PUSH, 0.0], (4, 1)))
    assert course.readings[0, 2:] == pytest.approx([1.0, 2.0])
    assert course.count == 2


def test_without_a_step_nothing_was_read() -> None:
    told = replace(record_of().told, apparatus=Apparatus.WHEEL)
    course = course_of(told, exchanges_of((CALLS[2], {"velocity": [0.0, 0.0, 0.0], "sim_time": 0.0})))
    assert (course.count, course.durations.shape, course.controls.shape) == (0, (1,), (1, 1))


def rivals_after(record: WorldRecord, calls: Sequence[Call], folder: Path) -> EvidenceRecord:
    subject, episode = played(record, folder, calls)
    return measured(subject, 0, episode, "")


def many_calls() -> list[Call]:
    """Return pushes in several directions and of several sizes, each with two readings."""
    looks = [call(tool, object_id="object_1") for tool in ("get_position", "get_velocity")]
    ways = [(3, 0), (-2, 3), (0, -4), (-1, 0), (2, 2), (4.5, -1), (-4, -2), (0, 3)]
    return [
        made
        for x, y in ways
        for made in (
            call("apply_force", object_id="object_1", force_vector=[float(x), float(y), 0.0]),
            *(one for _ in range(2) for one in (call("step", duration=0.45), *looks)),
        )
    ]


def test_readings_exclude_laws_that_differ_by_one_part_if_there_are_enough(tmp_path: Path) -> None:
    few = rivals_after(record_of(), CALLS, tmp_path / "few")
    some = rivals_after(record_of(), many_calls()[:42], tmp_path / "some")
    many = rivals_after(record_of(), many_calls(), tmp_path / "many")
    assert few.calls[-1].suffices
    assert not all(rival.excluded for rival in few.rivals)
    assert not few.suffices
    assert some.calls[-1].suffices
    assert {rival.excluded for rival in some.rivals} == {True, False}
    assert not some.suffices
    assert many.suffices


def test_a_law_that_contradicts_the_task_is_no_rival(tmp_path: Path) -> None:
    nothing = (0.0, 0.0)
    which = Question("which", nothing, nothing, nothing, 0.0, 0.0, "which", options=("swirl", "linear drag", "wind"))

    def acting(*asked: Question) -> set[tuple[str, ...]]:
        """Return, for all laws, which options act."""
        fits = WorldSolution(record_of(questions=asked)).rivals(exchanges_of())
        forms = [[term.split(" * ")[0] for term in name.removeprefix("puck: ").split("; ")] for name in fits]
        return {tuple(option for option in which.options if option in those) for those in forms}

    assert {len(options) for options in acting(ASKED)} == {0, 1, 2}
    assert acting(ASKED, which) == {(option,) for option in which.options}


def test_fits_that_fail_leave_the_episode_unmeasured(tmp_path: Path) -> None:
    subject, episode = played(record_of(), tmp_path)

    def failing(_: Exchanges) -> Mapping[str, object]:
        raise ZeroDivisionError

    broken = Subject(subject.files, subject.pack, replace(subject.solution, rivals=failing), subject.spec)
    assert "the fits of other laws fail" in measured(broken, 0, episode, "").not_measurable
