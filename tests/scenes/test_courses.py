"""Tests of fitting laws of motion to synthetic readings, computed in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from scenes.course_record import Course, force, position, recorded, velocity
from scenes.courses import PLAIN, Knobs, Laws, Predictor
from scenes.fitting import Array
from scenes.protocol import call

MASS, DRAG = 2.0, 0.7


def _rates(structure: str, knobs: Knobs, _: object, state: Array, controls: Array) -> Array:
    _, v = state
    lost = knobs["drag"] * (v if structure == "linear" else v * abs(v))
    return np.array([v, (controls[0] - lost) / knobs["mass"]])


LAWS = Laws(
    rates=_rates,
    structures={"linear": ("mass", "drag"), "square": ("mass", "drag")},
    box={"mass": (0.5, 8.0), "drag": (0.1, 5.0)},
    start=(0.0, 0.0),
    sigma=(1e-3, 1e-3),
)


def _course() -> Course:
    """A body with linear drag: v = F/c + (v0 - F/c) e^(-ct/m), and its integral."""
    durations, forces = (0.5, 0.8, 0.6, 1.0), (3.0, -2.0, 5.0, 1.0)
    x, v, readings = 0.0, 0.0, list[tuple[float, float]]()
    for duration, push in zip(durations, forces, strict=True):
        last, decay = push / DRAG, np.exp(-DRAG * duration / MASS)
        x, v = x + last * duration + (v - last) * MASS / DRAG * (1 - decay), last + (v - last) * decay
        readings.append((x, v))
    return Course(np.array(durations), np.array(forces)[:, None], np.array(readings))


def test_the_constants_of_a_course_in_closed_form_are_found() -> None:
    cost, knobs = LAWS.fitted(_course(), "linear")
    assert knobs == pytest.approx({"mass": MASS, "drag": DRAG}, rel=1e-3)
    assert cost < 1.0


def test_the_structure_that_made_the_course_is_preferred() -> None:
    assert LAWS.best(_course())[0] == "linear"


def test_a_hopeless_structure_is_not_fitted_to_the_whole_course() -> None:
    fits = replace(LAWS, hopeless=5.0).fits(_course())
    assert fits["linear"] == LAWS.fits(_course())["linear"]
    assert fits["square"][0] == np.inf > LAWS.fits(_course())["square"][0]
    assert replace(LAWS, hopeless=5.0).best(_course())[0] == "linear"


def test_missing_readings_are_left_out() -> None:
    course = _course()
    course.readings[1] = np.nan
    assert LAWS.fitted(course, "linear")[1] == pytest.approx({"mass": MASS, "drag": DRAG}, rel=1e-3)


def test_a_state_that_cannot_be_read_is_followed() -> None:
    def lagging(_: str, knobs: Knobs, __: object, state: Array, controls: Array) -> Array:
        _, v, passed_on = state
        return np.array([v, passed_on / knobs["mass"], (controls[0] - passed_on) / knobs["delay"]])

    laws = Laws(
        rates=lagging,
        structures={"late": ("mass", "delay")},
        box={"mass": (0.5, 8.0), "delay": (0.05, 2.0)},
        start=(0.0, 0.0, 0.0),
        sigma=(1e-3, 1e-3),
    )
    truth, course = {"mass": 3.0, "delay": 0.4}, _course()
    state = np.zeros((3, 1))
    for leg, (duration, control) in enumerate(zip(course.durations, course.controls, strict=True)):
        state = laws.advanced("late", truth, 0.0, state, duration, control[:, None])
        course.readings[leg] = state[:2, 0]
    assert laws.fitted(course, "late")[1] == pytest.approx(truth, rel=1e-3)


def test_a_course_is_recorded_from_calls_and_readings() -> None:
    exchanges = [
        (call("get_position", object_id="object_1"), {"position": [9.0, 0.0, 0.0]}),
        (call("apply_force", object_id="object_1", force_vector=[2.0, 1.0, 0.0]), {}),
        (call("apply_force", object_id="object_2", force_vector=[7.0, 0.0, 0.0]), {"force": 1}),
        (call("apply_force", object_id="object_1", force_vector=[2.0, 0.0, 0.0]), {"force": 1}),
        (call("step", duration=0.5), {"sim_time": 0.5}),
        (call("get_velocity", object_id="object_2"), {"velocity": [5.0, 0.0, 0.0]}),
        (call("get_velocity", object_id="object_1"), {"velocity": [4.0, 0.0, 0.0]}),
        (call("apply_force", object_id="object_1", force_vector=[99.0, 0.0, 0.0]), {"error": "beyond the limit"}),
        (call("step", duration=0.25), {"sim_time": 0.75}),
        (call("get_position", object_id="object_1"), {"position": [1.0, 0.0, 0.0]}),
    ]
    course = recorded(exchanges, [force("object_1", 0)], [position("object_1", 0), velocity("object_1", 0)])
    assert course.durations.tolist() == [0.5, 0.25]
    assert course.controls.tolist() == [[2.0], [2.0]]
    np.testing.assert_equal(course.readings, [[np.nan, 4.0], [1.0, np.nan]])


def test_a_course_ends_before_the_leg_that_a_latch_caught() -> None:
    course = _course()
    kept = course.until(np.array([False, False, True, False]))
    assert kept.durations.tolist() == course.durations[:2].tolist()
    assert kept.controls.shape == (2, 1)
    assert kept.readings.shape == (2, 2)
    assert len(course.until(np.zeros(4, bool)).durations) == 4


def test_a_predictor_answers_from_readings_by_a_structure_or_by_the_best() -> None:
    model = Predictor(LAWS, lambda _: _course(), lambda structure, knobs: [structure, knobs["mass"]])
    assert model.fit([], "linear") == ["linear", pytest.approx(MASS, rel=1e-3)]
    assert model.best([]) == model.fit([], "linear")


def _swinging(_: str, knobs: Knobs, __: object, state: Array, controls: Array) -> Array:
    x, v = state
    return np.array([v, controls[0] - knobs["w"] * x])


def _swung(legs: int, longest_s: float, starts: int) -> tuple[Laws, Course]:
    """Return the laws of a spring whose speed is not read, and readings of x = cos(3 t) every 0.35 s."""
    laws = Laws(
        rates=_swinging,
        structures={"spring": ("w",)},
        box={"w": (0.5, 400.0)},
        start=(1.0, 0.0),
        sigma=(0.02,),
        longest_s=longest_s,
        starts=starts,
        tried=1,
    )
    times = 0.35 * np.arange(1, legs + 1)
    return laws, Course(np.full(legs, 0.35), np.zeros((legs, 1)), np.cos(3 * times)[:, None])


def test_a_search_that_explains_nothing_is_repeated_from_other_starts() -> None:
    laws, course = _swung(60, 0.1, starts=8)
    assert laws.fitted(course, "spring")[0] > 1e4, "the first search should end in a local minimum"
    assert laws.best(course)[1]["w"] == pytest.approx(9.0, rel=1e-4)


def test_the_last_fit_takes_shorter_steps_than_the_search() -> None:
    """A step of 0.35 s is 1.05 rad of the swing, for which the Runge-Kutta phase error is half a per cent."""
    laws, course = _swung(12, 0.35, starts=200)
    assert laws.best(course)[1]["w"] == pytest.approx(9.0, rel=1e-3)


def test_a_structure_may_be_called_plain_where_there_is_no_plain_law_to_plan_with() -> None:
    laws = replace(LAWS, structures={"plain": ("mass", "drag")})
    assert laws.names(PLAIN) == ("mass", "drag")
    assert replace(LAWS, plain=("mass",)).names(PLAIN) == ("mass",)
