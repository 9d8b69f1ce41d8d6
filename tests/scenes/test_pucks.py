"""Tests of the protocol that pushes a puck: its calls, the mass that it finds, and that the puck stays on the floor."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from scenes.courses import Knobs, Laws
from scenes.fitting import Array
from scenes.local_law import LocalLaw
from scenes.protocol import Call
from scenes.pucks import PUCK, PuckFloor

MASS, DRAG = 2.5, 0.4


def _rates(_: str, knobs: Knobs, __: object, state: Array, controls: Array) -> Array:
    _x, _y, vx, vy = state
    return np.array([vx, vy, (controls[0] - DRAG * vx) / knobs["m"], (controls[1] - DRAG * vy) / knobs["m"]])


FLOOR = PuckFloor(
    laws=Laws(
        rates=_rates,
        structures={"drag": ("m",)},
        box={"m": (0.3, 6.0)},
        start=(0.0, 0.0, 0.0, 0.0),
        sigma=(1e-3, 1e-3, 2e-3, 2e-3),
        starts=20,
        tried=1,
    ),
    predict=lambda _, knobs: knobs["m"],
    targets=((1.5, 0.0), (0.0, -1.5)),
    near_m=0.5,
    safe_m=2.0,
    haste=2.0,
    leg_s=0.8,
    slowed=0.8,
    coasts_s=0.7,
    fixed_pushes=((1.0, 0.0, 1.0), (-1.0, 0.5, 0.6)),
    legs=6,
)


def _read(
    calls: list[Call], state: Array, held: Array, wind: Array | float = 0.0
) -> tuple[list[dict[str, Any]], Array, Array]:
    """Return readings on a floor with linear drag and a uniform force: v = F/c + (v0 - F/c) e^(-ct/m), and its
    integral.
    """
    found: list[dict[str, Any]] = []
    for asked in calls:
        if asked.tool == "apply_force":
            held = np.array(asked.arguments["force_vector"][:2])
            found.append({"status": "force set"})
        elif asked.tool == "step":
            duration = asked.arguments["duration"]
            last, decay = (held + wind) / DRAG, np.exp(-DRAG * duration / MASS)
            place = state[:2] + last * duration + (state[2:] - last) * MASS / DRAG * (1 - decay)
            state = np.concatenate([place, last + (state[2:] - last) * decay])
            found.append({"sim_time": duration})
        elif asked.tool == "get_position":
            found.append({"position": [*state[:2].tolist(), 0.0]})
        else:
            found.append({"velocity": [*state[2:].tolist(), 0.0]})
    return found, state, held


def test_a_push_is_held_and_looked_at_in_even_intervals() -> None:
    calls = FLOOR.push(np.array([1.23456, -2.0]), 0.75)
    assert calls[0].arguments == {"object_id": PUCK, "force_vector": [1.235, -2.0, 0.0]}
    assert [asked.tool for asked in calls[1:]] == ["step", "get_position", "get_velocity"] * 2
    assert [asked.arguments["duration"] for asked in calls if asked.tool == "step"] == pytest.approx([0.375, 0.375])


def test_the_mass_follows_from_pushes_also_with_drag() -> None:
    calls = [*FLOOR.push(np.array([3.0, 0.0]), 0.6), *FLOOR.push(np.array([-4.0, 2.0]), 0.6)]
    readings, _, _ = _read(calls, np.zeros(4), np.zeros(2))
    assert FLOOR.mass(list(zip(calls, readings, strict=True))) == pytest.approx(MASS, rel=0.03)


def test_the_push_that_is_chosen_leads_towards_the_target_and_never_far_out() -> None:
    push = FLOOR.aimed(np.zeros(2), np.zeros(2), np.array([1.5, 0.0]))
    assert push[0] > 0
    assert abs(push[1]) < 0.3
    fast = FLOOR.aimed(np.array([1.8, 0.0]), np.array([2.0, 0.0]), np.array([1.9, 0.0]))
    assert fast[0] < -1


@pytest.mark.parametrize("protocol", [FLOOR.solve, FLOOR.batch], ids=["solve", "batch"])
def test_a_protocol_played_on_a_floor_in_closed_form_finds_its_mass(protocol: Any) -> None:
    playing, state, held = protocol(""), np.zeros(4), np.zeros(2)
    calls = next(playing)
    while calls[-1].tool != "answer":
        readings, state, held = _read(calls, state, held)
        assert np.hypot(*state[:2]) < FLOOR.safe_m + 0.5
        calls = playing.send(readings)
    assert calls[-1].arguments["answer"] == pytest.approx(MASS, rel=0.01)


def test_a_puck_of_known_mass_may_be_steered_by_another_rule() -> None:
    def steer(place: Array, speed: Array, target: Array) -> Array:
        return MASS * (2.5 * (target - place) - 2.0 * speed)

    playing, state, held = replace(FLOOR, steer=steer).solve(""), np.zeros(4), np.zeros(2)
    calls = next(playing)
    assert calls[0].arguments["force_vector"] == [2.5 * MASS * 1.5, 0.0, 0.0]
    while calls[-1].tool != "answer":
        readings, state, held = _read(calls, state, held)
        calls = playing.send(readings)
    assert calls[-1].arguments["answer"] == pytest.approx(MASS, rel=0.01)


def test_what_is_read_beyond_the_rim_is_left_out() -> None:
    calls = [*FLOOR.push(np.array([3.0, 0.0]), 1.0), *FLOOR.push(np.array([6.0, 0.0]), 1.0)]
    readings, _, _ = _read(calls, np.zeros(4), np.zeros(2))
    exchanges = list(zip(calls, readings, strict=True))
    places = FLOOR.course(exchanges).readings[:, 0]
    kept = replace(FLOOR, rim_m=float(places[2]) - 0.01).course(exchanges)
    assert kept.readings[:, 0].tolist() == places[:2].tolist()
    assert len(replace(FLOOR, rim_m=9.0).course(exchanges).durations) == len(places) == 4


@pytest.mark.parametrize("wind", [(1.5, -1.0), (-2.0, 0.0)])
def test_a_puck_that_drifts_is_first_watched_and_then_held_on_the_floor(wind: tuple[float, float]) -> None:
    floor = replace(FLOOR, drifts=True, idle_legs=1, growth=20.0, legs=12)
    playing, state, held = floor.solve(""), np.zeros(4), np.zeros(2)
    seen, calls = list[tuple[Call, Any]](), next(playing)
    assert calls[0].arguments["force_vector"] == [0.0, 0.0, 0.0]
    while calls[-1].tool != "answer":
        readings, state, held = _read(calls, state, held, np.array(wind))
        assert np.hypot(*state[:2]) < FLOOR.safe_m + 0.5
        seen += zip(calls, readings, strict=True)
        calls = playing.send(readings)
    assert floor.drift(seen) == pytest.approx(np.array(wind) / MASS, rel=0.05, abs=0.02)
    assert floor.mass(seen) == pytest.approx(MASS, rel=0.05)


@pytest.mark.parametrize("wind", [(0.0, 0.0), (0.5, -0.3), (-0.8, 0.0)])
def test_a_force_that_acts_besides_never_leads_a_puck_of_unknown_mass_to_the_rim(wind: tuple[float, float]) -> None:
    floor = replace(FLOOR, wanders=0.5, legs=12)
    playing, state, held = floor.solve(""), np.zeros(4), np.zeros(2)
    seen, calls = list[tuple[Call, Any]](), next(playing)
    while calls[-1].tool != "answer":
        readings, state, held = _read(calls, state, held, np.array(wind))
        assert np.hypot(*state[:2]) < FLOOR.safe_m + 0.5
        seen += zip(calls, readings, strict=True)
        calls = playing.send(readings)
    assert floor.mass(seen) < 1 / floor.local(seen).lightness == pytest.approx(MASS, rel=0.05)


def test_a_push_is_smaller_if_the_mass_may_be_smaller() -> None:
    state, target = np.array([0.6, 0.0, 0.2, 0.0]), np.array([1.9, 0.0])
    sure, unsure = (FLOOR.planned(state, target, LocalLaw(1 / MASS, error), MASS) for error in (0.0, 2 / MASS))
    assert sure[0] > unsure[0]
