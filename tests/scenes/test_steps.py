"""Tests of pushing a body in oil stepwise: forces, readings at rest, fitted constants, parts that engage late."""

from typing import Any

import numpy as np
import pytest

from scenes.fitting import Array
from scenes.protocol import Call, Exchanges, call
from scenes.steps import LateParts, PushSteps, fitted_from, fitted_strengths

STIFFNESS, OIL = 30.0, 40.0
STEPS = PushSteps(
    bodies=("object_2", "object_1"),
    top_m=0.6,
    deepest=0.2,
    enough=0.18,
    fastest=0.05,
    share=0.8,
    room=3.0,
    first_n=0.1,
    most=20,
    singly=4,
    look_s=0.05,
    wait_s=5.0,
    least_m=5e-4,
    least_m_s=5e-4,
)


class _Body:
    """A body on a spring in oil; a second body is displaced by a tenth of its displacement."""

    def __init__(self) -> None:
        self.force = self.way = self.speed = self.fastest = 0.0

    def read(self, asked: Call) -> dict[str, Any]:
        if asked.tool == "apply_force":
            self.force = -asked.arguments["force_vector"][2]
        elif asked.tool == "step":
            for _ in range(round(asked.arguments["duration"] / 0.005)):
                self.speed = (self.force - STIFFNESS * self.way) / OIL
                self.fastest = max(self.fastest, self.speed)
                self.way += 0.005 * self.speed
        elif asked.tool == "get_velocity":
            return {"velocity": [0.0, 0.0, -self.speed]}
        else:
            own = asked.arguments["object_id"] == "object_2"
            return {"position": [0.0, 0.0, 0.6 - self.way if own else self.way / 10]}
        return {"status": "done"}


def test_steps_reach_the_place_that_is_enough_and_stay_slow() -> None:
    body, protocol = _Body(), STEPS.pushed()
    calls = next(protocol)
    while True:
        try:
            calls = protocol.send([body.read(asked) for asked in calls])
        except StopIteration as ended:
            seen = ended.value
            break
    assert STEPS.enough <= body.way <= STEPS.deepest
    assert body.fastest < STEPS.fastest
    forces, ways, levels = np.array(STEPS.rows(seen)).T
    assert len(ways) > 4
    assert levels == pytest.approx(ways / 10)
    cost, strengths = fitted_strengths(lambda at: at[:, None], ways, forces, 1e-3, 4)
    assert strengths == pytest.approx([STIFFNESS], rel=0.05)
    assert cost < len(ways)


def test_rows_end_where_the_body_is_beyond_the_deepest_place() -> None:
    calls = [STEPS.push(1.0), *STEPS.rest(), STEPS.push(9.0), *STEPS.rest(), STEPS.push(1.0), *STEPS.rest()]
    heights = iter((0.55, 0.01, 0.3, 0.02, 0.55, 0.01))
    readings = [{"position": [0, 0, next(heights)]} if asked.tool == "get_position" else {} for asked in calls]
    assert STEPS.rows(list(zip(calls, readings, strict=True))) == [(1.0, pytest.approx(0.05), 0.01)]


def test_looks_in_motion_are_no_rows() -> None:
    seen: list[tuple[Call, dict[str, Any]]] = [
        (call("step", duration=0.05), {}),
        (call("get_position", object_id="object_2"), {"position": [0, 0, 0.5]}),
        (call("get_position", object_id="object_1"), {"position": [0, 0, 0.5]}),
    ]
    assert STEPS.rows(seen) == []


def test_errors_of_places_weigh_by_the_slope_and_negative_strengths_are_refused() -> None:
    places = np.linspace(0.02, 0.2, 12)

    def columns(at: Array) -> Array:
        return np.stack([at, at**3], axis=-1)

    cost, strengths = fitted_strengths(columns, places, 20 * places + 900 * places**3, 1e-4, 4)
    assert strengths == pytest.approx([20, 900], rel=1e-6)
    assert cost < 1e-6
    assert fitted_strengths(columns, places, 20 * places - 100 * places**3, 1e-4, 4)[0] > 1e3


def test_the_best_of_several_starts_is_followed_to_its_end() -> None:
    def misfits(at: Array) -> Array:
        return np.array([2 + np.cos(3 * at[0]) + at[0] / 4, 0.1])  # different minima at -1.1, 1.0 and 3.0

    starts = ([0.8], [-1.5], [2.9])
    cost, best = fitted_from(misfits, starts, ([-2.0], [3.0]), [1.0])
    alone = [fitted_from(misfits, (start,), ([-2.0], [3.0]), [1.0])[0] for start in starts]
    assert cost == pytest.approx(min(alone))
    assert max(alone) > 1.5 * min(alone)
    assert cost == pytest.approx(float((misfits(best) ** 2).sum()))


LATE = LateParts(lambda part, points: points[0] - part[2], least=0.001, times=2)
"""Parts that carry load once the first coordinate exceeds their gap."""


def test_parts_that_were_hardly_pressed_are_not_known() -> None:
    constants = np.array([1.0, 2.0, 3.0, 0.5, 7.0, 0.01, 0.6, 8.0, 0.04])
    points = np.array([[0.005, 0.02, 0.03, 0.042]])
    assert LATE.known(constants, points).tolist() == [1, 2, 3, 0.5, 7.0, 0.01, 0.6, 0.0, 0.04]
    assert constants[7] == 8.0


def test_later_rounds_use_what_is_known_and_the_last_fit_is_returned() -> None:
    told: list[tuple[str, list[float], float, float]] = []

    def calls(structure: str, known: Array, trust: float, aim: float) -> list[Call]:
        told.append((structure, known.tolist(), trust, aim))
        return [call("get_position", object_id="object_1")]

    def fit(exchanges: Exchanges) -> tuple[str, Array, Array]:
        places = np.array([[reading["angle"] for _, reading in exchanges]])
        return f"after {len(exchanges)}", np.array([1.0, 2.0, 3.0, 0.5, 7.0, 0.01]), places

    seen: list[tuple[Call, dict[str, Any]]] = []
    protocol = LATE.approached(seen, ((0.0, (1.0, 2.0)), (0.5, (3.0,)), (0.8, (4.0,))), np.ones(3), calls, fit)
    asked, angles = next(protocol), iter((0.005, 0.02, 0.03, 0.04))
    while True:
        try:
            asked = protocol.send([{"angle": next(angles)} for _ in asked])
        except StopIteration as ended:
            structure, constants = ended.value
            break
    assert told[:2] == [("", [1, 1, 1], 0.0, 1.0), ("", [1, 1, 1], 0.0, 2.0)]
    assert told[2] == ("after 2", [1, 2, 3, 0.5, 0.0, 0.01], 0.5, 3.0)
    assert told[3] == ("after 3", [1, 2, 3, 0.5, 7.0, 0.01], 0.8, 4.0)
    assert structure == "after 4"
    assert constants.tolist() == [1, 2, 3, 0.5, 7.0, 0.01]
    assert len(seen) == 4
