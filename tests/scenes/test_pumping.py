"""Tests of pumping a body on a spring: half swings end at rest, grow, and stay in reach under every plausible law."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from scenes.course_record import force, position, velocity
from scenes.fitting import Array
from scenes.protocol import Call
from scenes.pumping import Pump, turning_ways
from scenes.rigs import Rig, lasting

MASS, STIFFNESS, REACH_M, PUSH_N = 2.0, 9.0, 0.8, 1.5
PUMP = Pump(
    Rig([force("object_1", 0)], [position("object_1", 0), velocity("object_1", 0)], decimals=6),
    lambda constants, x: constants[1] * x**2 / 2,
    lambda constants: constants[0],
    PUSH_N,
    REACH_M,
    lambda _: (0.25, 0.5, 0.75, 1.0),
    calls=100,
    time_s=30.0,
    singly=2,
)
KNOWN = np.array([[MASS], [STIFFNESS]])


def _followed(calls: list[Call], state: tuple[float, float], stiffness: float = STIFFNESS) -> Array:
    """Return positions and speeds of a body on a spring at each reading, in closed form; shape (readings, 2)."""
    (x, v), rest, turn, path = state, 0.0, (stiffness / MASS) ** 0.5, list[tuple[float, float]]()
    for asked in calls:
        if asked.tool == "apply_force":
            rest = asked.arguments["force_vector"][0] / stiffness
        elif asked.tool == "step":
            angle = turn * asked.arguments["duration"]
            x, v = (
                rest + (x - rest) * np.cos(angle) + v / turn * np.sin(angle),
                v * np.cos(angle) - turn * (x - rest) * np.sin(angle),
            )
            path.append((x, v))
    return np.array(path)


def _held(push: float) -> Call:
    return Call("apply_force", {"object_id": "object_1", "force_vector": [push, 0.0, 0.0]})


def _pushes(calls: list[Call]) -> list[float]:
    return [asked.arguments["force_vector"][0] for asked in calls if asked.tool == "apply_force"]


def test_half_swings_end_at_rest_and_grow_up_to_the_reach() -> None:
    calls = PUMP.half_swings(KNOWN, 0.1, -0.2, 6)
    path = _followed(calls, (0.1, -0.2))
    ends = path[3::4]
    assert abs(ends[:, 1]).max() < 0.03
    assert np.sign(ends[:, 0]).tolist() == [-1, 1, -1, 1, -1, 1]
    assert (np.diff(abs(ends[:, 0])) > -1e-3).all()
    assert _pushes(calls)[:2] == [-PUSH_N, PUSH_N]
    assert abs(path[:, 0]).max() <= REACH_M + 1e-3
    assert abs(ends[-1, 0]) > 0.95 * REACH_M


def test_no_plausible_member_passes_the_reach() -> None:
    """The pushes are limited by the softest plausible spring, which must not swing beyond the reach."""
    soft = 0.7 * STIFFNESS
    both = np.array([[MASS, MASS], [STIFFNESS, soft]])
    start = (0.6, -0.1)
    planned = PUMP.half_swings(both, *start, 1)
    assert abs(_followed(planned, start, soft)[:, 0]).max() <= REACH_M
    bold = PUMP.half_swings(KNOWN, *start, 1)
    assert abs(_pushes(planned)[0]) < abs(_pushes(bold)[0])


def test_a_body_that_is_about_to_turn_back_is_led_to_the_other_side() -> None:
    start = (0.6, 0.05)
    calls = PUMP.half_swings(KNOWN, *start, 1)
    end = _followed(calls, start)[-1]
    assert end[0] < -0.6
    assert abs(end[1]) < 0.03


def test_a_body_beyond_the_force_is_braked_with_all_of_it() -> None:
    calls = PUMP.half_swings(KNOWN, 0.0, 9.0, 1)
    assert _pushes(calls) == [-PUSH_N]


def _pumped(pump: Pump) -> list[list[Call]]:
    """Return the calls of each turn when a body on the spring is pumped up from rest."""
    turns, state, push = list[list[Call]](), (0.0, 0.0), 0.0
    led = pump.pumped(pump.rig.along(PUSH_N, (0.2, 0.4)), lambda _: KNOWN)
    calls = next(led)
    while True:
        turns.append(calls)
        found = list[dict[str, Any]]()
        for asked in calls:
            if asked.tool == "apply_force":
                push = asked.arguments["force_vector"][0]
            if asked.tool == "step":
                state = _followed([_held(push), asked], state)[-1].tolist()
            place, speed = [state[0], 0, 0], [state[1], 0, 0]
            found.append({"get_position": {"position": place}, "get_velocity": {"velocity": speed}}.get(asked.tool, {}))
        try:
            calls = led.send(found)
        except StopIteration:
            return turns


def test_half_swings_are_planned_singly_then_in_pairs_until_calls_are_used_up() -> None:
    assert [len(_pushes(turn)) for turn in _pumped(PUMP)] == [1, 1, 1, 2, 2, 1]
    assert sum(len(turn) for turn in _pumped(PUMP)) <= PUMP.calls < sum(len(turn) for turn in _pumped(PUMP)) + 13


def test_half_swings_end_when_the_next_would_take_too_long() -> None:
    brief = _pumped(replace(PUMP, time_s=3.0))
    assert 1 < len(brief) < len(_pumped(PUMP))
    assert sum(lasting(turn) for turn in brief) <= 3.0


def test_ways_end_where_no_energy_is_left() -> None:
    ways = np.linspace(0.0, 2.0, 5) + np.zeros((3, 1))
    left = np.array([[1.0, 0.25, -0.25, -1.0, 5.0], [1.0, 1.0, 1.0, 1.0, 0.5], [0.0, -1.0, -1.0, -1.0, -1.0]])
    assert turning_ways(left, ways) == pytest.approx([0.75, 2.0, 0.0])
