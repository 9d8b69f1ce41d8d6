"""Tests of driving a swing: first small pushes, fits to each leg, planned pushes that keep the swing within reach."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from scenes.course_record import Course, force, position, velocity
from scenes.courses import PLAIN, Knobs, Laws, Predictor
from scenes.fitting import Array
from scenes.protocol import Call, Exchanges
from scenes.rigs import Rig
from scenes.swings import LegFit, Swing, SwingPlan, to_a_side, to_and_fro

MASS, STIFFNESS, REACH_M = 2.0, 9.0, 0.4


def _rates(_: str, knobs: Knobs, __: object, state: Array, controls: Array) -> Array:
    x, v = state
    return np.array([v, controls[0] / knobs["m"] - knobs["w"] * x])


LAWS = Laws(
    rates=_rates,
    structures={"spring": ("m", "w")},
    box={"m": (0.1, 20.0), "w": (2.0, 30.0)},
    start=(0.0, 0.0),
    sigma=(1e-4, 1e-4),
    longest_s=0.05,
    starts=20,
    tried=1,
    plain=("m", "w"),
)
RIG = Rig([force("object_1", 0)], [position("object_1", 0), velocity("object_1", 0)], decimals=6)


def _course(readings: Exchanges) -> Course:
    return RIG.course(readings)


SWING = Swing(
    rig=RIG,
    model=Predictor(LAWS, _course, lambda _, knobs: [knobs["m"], knobs["w"]]),
    rough=LegFit(LAWS),
    touches=(0.01, 0.1, 1.0, 10.0),
    moved=lambda reading: abs(reading[1]) > 0.03,
    strongest=lambda plan: plan.reach * plan.knobs["w"] * plan.knobs["m"],
    worth=lambda plan, path: to_a_side(plan, path[:, 0], 0.2, abs(path[:, 0])),
    span=lambda knobs: float(0.9 / np.sqrt(knobs["w"])),
    reaches=(0.1, 0.2, REACH_M),
    wider=lambda course: 0.04 + 2 * float(abs(course.readings[:, 0]).max()),
    time_s=6.0,
    fixed_pushes=(0.5, 0.0, -2.0, 1.0),
    fixed_s=0.3,
)


def _read(calls: list[Call], state: Array, held: float) -> tuple[list[dict[str, Any]], Array, float]:
    """Return readings of a glider on a spring in closed form, and its last state and force.

    It oscillates about F / (m w), where w is the stiffness per mass.
    """
    found: list[dict[str, Any]] = []
    for asked in calls:
        if asked.tool == "apply_force":
            held = asked.arguments["force_vector"][0]
            found.append({"status": "force set"})
        elif asked.tool == "step":
            turn, rest = np.sqrt(STIFFNESS), held / MASS / STIFFNESS
            c, s = np.cos(turn * asked.arguments["duration"]), np.sin(turn * asked.arguments["duration"])
            x, v = state
            state = np.array([rest + (x - rest) * c + v / turn * s, v * c - turn * (x - rest) * s])
            found.append({"sim_time": 0.0})
        elif asked.tool == "get_position":
            found.append({"position": [state[0], 0.0, 0.0]})
        else:
            found.append({"velocity": [state[1], 0.0, 0.0]})
    return found, state, held


def _played(protocol: Any) -> tuple[list[list[Call]], list[float], Any]:
    """Return calls, positions and answer of a protocol."""
    playing, state, held = protocol(""), np.zeros(2), 0.0
    batches, places = [next(playing)], list[float]()
    while batches[-1][-1].tool != "answer":
        readings, state, held = _read(batches[-1], state, held)
        places += [reading["position"][0] for reading in readings if "position" in reading]
        batches.append(playing.send(readings))
    return batches, places, batches[-1][-1].arguments["answer"]


@pytest.mark.parametrize("protocol", [SWING.solve, SWING.batch], ids=["solve", "batch"])
def test_a_protocol_played_on_a_spring_in_closed_form_finds_its_constants(protocol: Any) -> None:
    assert _played(protocol)[2] == pytest.approx([MASS, STIFFNESS], rel=1e-3)


def test_touches_grow_until_the_body_moves_and_swings_grow_up_to_the_reach() -> None:
    batches, places, _ = _played(SWING.solve)
    touches = [calls[0].arguments["force_vector"][0] for calls in batches[:3]]
    assert touches == [0.01, 0.1, 1.0]
    assert max(np.abs(places)) == pytest.approx(REACH_M, rel=0.15)
    assert max(places) > 0.3
    assert min(places) < -0.3
    assert sum(len(calls) for calls in batches) - 1 <= SWING.calls


def test_time_and_calls_of_planned_legs_are_bounded() -> None:
    batches, _, _ = _played(SWING.solve)
    planned = [asked for calls in batches[4:-1] for asked in calls if asked.tool == "step"]
    assert 0 < sum(asked.arguments["duration"] for asked in planned) <= SWING.time_s


def _record() -> Course:
    calls = [asked for push in (1.0, -3.0, 2.0, 0.0) for asked in RIG.leg(push, 0.3)]
    readings, _, _ = _read(calls, np.zeros(2), 0.0)
    return RIG.course(list(zip(calls, readings, strict=True)))


def test_a_fit_leg_by_leg_finds_the_constants_and_goes_on_from_what_is_known() -> None:
    fit = LegFit(LAWS, spread=1.0, pull=0.1)
    unit = fit.unit(_record(), PLAIN)
    assert LAWS.constants(PLAIN, unit) == pytest.approx({"m": MASS, "w": STIFFNESS}, rel=1e-3)
    near = fit.unit(_record(), PLAIN, np.clip(unit + 0.05, 0, 1))
    assert near == pytest.approx(unit, abs=1e-3)
    cost, constants = fit.fitted(_record(), "spring")
    assert constants == pytest.approx({"m": MASS, "w": STIFFNESS}, rel=1e-3)
    assert cost < 1.0
    assert fit.best(_record()) == ("spring", constants)


def _either(structure: str, knobs: Knobs, _: object, state: Array, controls: Array) -> Array:
    x, v = state
    return np.array([v, controls[0] / knobs["m"] - knobs["w"] * (x if structure == "spring" else abs(x) * x)])


def test_structures_that_the_readings_exclude_are_not_plausible() -> None:
    laws = replace(LAWS, rates=_either, structures={"spring": ("m", "w"), "square": ("m", "w")})
    fit = LegFit(laws, spread=1.0, pull=0.1)
    assert [structure for structure, _ in fit.plausible(_record(), 4.0)] == ["spring"]
    assert [structure for structure, _ in fit.plausible(_record(), np.inf)] == ["spring", "square"]
    assert fit.plausible(_record(), 4.0)[0][1] == pytest.approx({"m": MASS, "w": STIFFNESS}, rel=1e-3)


@pytest.mark.parametrize(("limit", "within"), [(np.inf, False), (0.4, True)])
def test_planned_pushes_keep_to_a_limit_under_every_plausible_law(limit: float, within: bool) -> None:
    softer = {"m": MASS, "w": STIFFNESS / 2}
    swing = replace(SWING, plausible=lambda _: [("spring", softer)], limit=limit, legs=SWING.ahead)
    course, span = _record(), 0.3
    pushes = swing.planned(SwingPlan({"m": MASS, "w": STIFFNESS}, course, span, REACH_M, 1, span / swing.looks))
    states, places = course.readings[-1][:, None], list[float]()
    for push in pushes:
        for _ in range(swing.looks):
            states = LAWS.advanced("spring", softer, 0.0, states, span / swing.looks, push)
            places.append(float(abs(states[0, 0])))
    assert (max(places) <= 0.4 + 1e-9) == within


def test_a_start_that_nobody_knows_does_not_disturb_a_fit_leg_by_leg() -> None:
    course = _record()
    course.readings[0] = np.nan
    found = LegFit(LAWS, spread=1.0, pull=0.1).fitted(course, "spring")[1]
    assert found == pytest.approx({"m": MASS, "w": STIFFNESS}, rel=1e-3)


def test_a_path_is_worth_more_to_the_wanted_side_and_little_beyond_the_reach() -> None:
    plan = SwingPlan({}, _record(), 0.3, 0.4, -1, 0.1)
    place = np.array([[-0.3, 0.3, -0.5], [0.0, 0.0, 0.0]])
    worth = to_a_side(plan, place, 0.2, np.zeros((2, 3)))
    assert worth == pytest.approx([1.0, 0.0, 2.0 - 100.0])


def test_random_pushes_are_shares_of_the_strongest() -> None:
    shares = to_and_fro(np.random.default_rng(0), 5, 40, (-1.0, 0.0, 0.5))
    assert shares.shape == (5, 1, 40)
    assert set(shares.ravel().tolist()) == {-1.0, 0.0, 0.5}
