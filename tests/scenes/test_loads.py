"""Tests of balls of known mass: their mass, loading of pans and levers, and the data extracted from calls."""

from math import cos, pi
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from scenes.loads import GRAVITY, Lever, Pan, ball, dense_ball, hung, joined, looks, mass_of, torque_at_spin
from scenes.protocol import Call

STIFFNESS, OIL = 12.0, 3.0
DONE: dict[str, Any] = {"status": "done"}
PAN = Pan(top_m=2.0, catch_m=0.2)
LEVER = Lever(widest=0.4, enough=0.35, fastest=0.05, share=0.8, room=2.5, first_kg=0.01, most=20, singly=3, look_s=0.05)


def test_a_ball_of_a_radius_or_of_a_density_has_the_asked_mass() -> None:
    assert mass_of(ball("b", 2.5, (0, 0, 1), 0.1)) == pytest.approx(2.5)
    dense = dense_ball("b", 2.5, (0, 0, 1), 1e5)
    assert mass_of(dense) == pytest.approx(2.5)
    assert dense.arguments["radius"] == pytest.approx((2.5 / 1e5 / (4 / 3 * pi)) ** (1 / 3))
    assert [asked.tool for asked in joined(dense, "object_1")] == ["create_objects", "attach_objects"]


def test_a_pan_is_loaded_with_a_ball_instead_of_the_one_before() -> None:
    first, second = PAN.load(0, 1.0, [2.0]), PAN.load(1, 3.0, [1.0, 0.5], radius=0.12)
    assert [asked.tool for asked in first] == ["create_objects", "attach_objects", "step", "get_position"]
    assert second[2] == Call("delete_objects", {"object_id": "b0"})
    assert second[3:] == looks("object_1", [1.0, 0.5])
    assert second[0].arguments["radius"] == 0.12
    assert mass_of(second[0]) == pytest.approx(3.0)


def test_the_course_of_a_pan_has_weights_and_ways_until_the_catch() -> None:
    calls = [*PAN.load(0, 1.0, [2.0]), *PAN.load(1, 3.0, [1.0, 0.5]), *PAN.load(2, 9.0, [1.0])]
    heights = iter((1.95, 1.9, 1.89, 1.7))
    readings = [{"position": [0.0, 0.0, next(heights)]} if asked.tool == "get_position" else DONE for asked in calls]
    course = PAN.course(list(zip(calls, readings, strict=True)))
    assert course.durations.tolist() == [2.0, 1.0, 0.5]
    assert course.controls[:, 0] == pytest.approx(np.array([1.0, 3.0, 3.0]) * GRAVITY)
    assert course.readings[:, 0] == pytest.approx([0.05, 0.1, 0.11])


def test_a_refused_load_weighs_nothing() -> None:
    calls = PAN.load(0, 1.0, [2.0])
    readings: list[dict[str, Any]] = [{"error": "no"}, {"error": "no"}, DONE, {"position": [0, 0, 2.0]}]
    assert PAN.course(list(zip(calls, readings, strict=True))).controls.tolist() == [[0.0]]


class _Wheel:
    """A wheel on a spring in thick oil: k a = sum of m g l cos(a - b), each ball attached at the angle b."""

    def __init__(self) -> None:
        self.made: dict[str, float] = {}
        self.balls: list[tuple[float, float]] = []
        self.angle = self.spin = self.fastest = 0.0

    def torque(self) -> float:
        return sum(kg * GRAVITY * LEVER.arm_m * cos(self.angle - joined_at) for kg, joined_at in self.balls)

    def read(self, asked: Call) -> dict[str, Any]:
        if asked.tool == "create_objects":
            self.made[asked.arguments["name"]] = mass_of(asked)
        elif asked.tool == "attach_objects":
            self.balls.append((self.made[asked.arguments["object1_id"]], self.angle))
        elif asked.tool == "step":
            for _ in range(round(asked.arguments["duration"] / 0.005)):
                self.spin = (self.torque() - STIFFNESS * self.angle) / (4 * OIL)
                self.fastest = max(self.fastest, self.spin)
                self.angle += 0.005 * self.spin
        elif asked.tool == "get_velocity":
            return {"angular_velocity": self.spin}
        else:
            return {"angle": self.angle}
        return {}


def test_balls_turn_a_lever_as_far_as_asked_and_never_too_fast() -> None:
    wheel, protocol = _Wheel(), LEVER.turned()
    calls = next(protocol)
    while True:
        try:
            calls = protocol.send([wheel.read(asked) for asked in calls])
        except StopIteration as ended:
            seen, number = ended.value
            break
    assert LEVER.enough <= wheel.angle <= LEVER.widest
    assert 3 < number <= LEVER.most
    assert wheel.fastest < LEVER.fastest
    torques, angles = np.array(LEVER.torques(seen)).T
    assert len(angles) == number
    assert torques[-1] / angles[-1] == pytest.approx(STIFFNESS, rel=0.15)
    assert torques[-1] == pytest.approx(wheel.torque(), rel=1e-9)


def test_angles_beyond_the_range_and_looks_in_motion_are_no_torques() -> None:
    calls = [*LEVER.ball(0, 0.1), *LEVER.look(), *LEVER.rest(), *LEVER.ball(1, 5.0), *LEVER.rest()]
    readings = [{}, {}, {}, {"angular_velocity": 0.1}, {}, {"angle": 0.1}, {}, {}, {}, {"angle": 0.5}]
    rows = LEVER.torques(list(zip(calls, readings, strict=True)))
    assert rows == [(pytest.approx(0.1 * GRAVITY * 0.5 * cos(0.1)), 0.1)]


def test_the_masses_on_each_body_are_followed_call_by_call() -> None:
    calls = [
        *joined(ball("a", 1.0, (0, 0, 1), 0.1), "object_1"),
        *joined(ball("b", 3.0, (0, 0, 1), 0.1), "object_2"),
        Call("attach_objects", {"object1_id": "object_3", "object2_id": "object_1"}),
        Call("delete_objects", {"object_id": "a"}),
    ]
    loads = [dict(load) for _, _, load in hung([(asked, DONE) for asked in calls])]
    assert loads[1]["object_1"] == pytest.approx(1.0)
    assert loads[3] == pytest.approx({"object_1": 1.0, "object_2": 3.0})
    assert loads[4] == loads[3]
    assert loads[5] == pytest.approx({"object_1": 0.0, "object_2": 3.0})
    refused = [(asked, {"error": "no"}) for asked in calls]
    assert list(hung(refused)) == []


def test_a_pan_is_loaded_more_and_more_until_it_sinks_visibly() -> None:
    protocol, calls, way = PAN.scaled(0.002, 4.0, 0.006, 3.0), list[Call](), 0.0
    calls = next(protocol)
    while True:
        way = mass_of(calls[0]) * 0.1
        height = {"position": [0.0, 0.0, 2.0 - way]}
        try:
            calls = protocol.send([height if asked.tool == "get_position" else DONE for asked in calls])
        except StopIteration as ended:
            seen, number, kg = ended.value
            break
    assert way >= 0.006
    assert (number, kg) == (4, pytest.approx(0.002 * 4.0**4))
    assert PAN.course(seen).controls[:, 0] == pytest.approx(GRAVITY * 0.002 * 4.0 ** np.arange(4))


class _Engine:
    """A fake engine with a damped wheel and pans, and time steps of 0.01 s."""

    def __init__(self, drag: float) -> None:
        self.drag, self.torque, self.spin = drag, 0.0, 0.0

    def whole_steps(self, seconds: float) -> int:
        return round(seconds / 0.01)

    def turn(self, _: str) -> Any:
        return SimpleNamespace(spin=self.spin)

    def push(self, _: str, torque: Any) -> None:
        self.torque = float(torque[2])

    def step(self, _: int) -> None:
        self.spin += 0.01 * (self.torque - self.drag * self.spin)


def test_the_torque_at_a_spin_is_that_of_the_resistance() -> None:
    found = torque_at_spin(_Engine(0.7), "object_1", 20.0, stiff=4.0, lasting=0.05)
    assert found == pytest.approx(0.7 * 20.0, rel=1e-3)
