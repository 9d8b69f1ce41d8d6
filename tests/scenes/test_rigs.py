"""Tests of `Rig`: the calls of a push with its readings, the data from their results, and growing first pushes."""

import numpy as np
import pytest

from scenes.course_record import force, position, velocity
from scenes.protocol import Call
from scenes.rigs import Rig, motion

TWO = Rig([force("object_1", 0), force("object_1", 2), force("object_2", 1)], [position("object_1", 0)], decimals=2)


def test_a_leg_sets_every_control_and_reads_after_each_part() -> None:
    calls = TWO.leg((1.234, 5.0), 0.0502, looks=2)
    assert [asked.arguments.get("force_vector") for asked in calls[:2]] == [[1.23, 0.0, 5.0], [0.0, 0.0, 0.0]]
    assert [asked.tool for asked in calls[2:]] == ["step", "get_position"] * 2
    assert calls[2].arguments["duration"] == pytest.approx(0.025)
    assert TWO.leg(3.0, 0.0)[2].arguments["duration"] == pytest.approx(0.005)


def test_channels_of_one_call_are_read_together() -> None:
    rig = Rig([force("object_1", 0)], [of("object_1", axis) for of in (position, velocity) for axis in (0, 1)])
    assert [asked.tool for asked in rig.leg(1.0, 0.1)] == ["apply_force", "step", "get_position", "get_velocity"]


def test_the_calls_of_a_leg_are_read_back_as_a_course() -> None:
    calls = [*TWO.leg((1.0, 2.0, 3.0), 0.5), *TWO.leg(4.0, 0.25)]
    readings = [{"position": [float(number), 0.0, 0.0]} for number in range(len(calls))]
    course = TWO.course(list(zip(calls, readings, strict=True)))
    assert course.durations.tolist() == [0.5, 0.25]
    assert course.controls.tolist() == [[1.0, 2.0, 3.0], [4.0, 0.0, 0.0]]
    assert course.readings.tolist() == [[3.0], [7.0]]


def test_pushes_are_rounded_to_decimals_or_to_significant_digits() -> None:
    rig = Rig([force("object_1", 0)], [velocity("object_1", 0)], significant=3)
    assert rig.leg(0.00123456, 0.1)[0].arguments["force_vector"] == [0.00123, 0.0, 0.0]
    assert TWO.leg(0.00123456, 0.1)[0].arguments["force_vector"] == [0.0, 0.0, 0.0]


def test_motion_is_read_after_a_wait() -> None:
    assert [asked.tool for asked in motion(0.5)] == ["step", "get_position", "get_velocity"]
    assert motion(0.5, "object_2")[1] == Call("get_position", {"object_id": "object_2"})


def test_pushes_grow_until_a_reading_moves() -> None:
    rig = Rig([force("object_1", 0)], [velocity("object_1", 0)])
    touching, mass, speed = rig.touched(0.01, 3.0, 0.5, lambda reading: reading[0] > 0.1), 2.0, 0.0
    calls, pushes = next(touching), list[float]()
    while True:
        pushes.append(calls[0].arguments["force_vector"][0])
        speed += pushes[-1] * 0.5 / mass
        readings = [{"status": "set"}, {"sim_time": 0.5}, {"velocity": [speed, 0.0, 0.0]}]
        try:
            calls = touching.send(readings)
        except StopIteration as ended:
            seen, last = ended.value
            break
    assert pushes == pytest.approx([0.01, 0.03, 0.09, 0.27, 0.81])
    assert last == pytest.approx(0.81)
    assert len(seen) == 15
    assert np.isfinite(rig.course(seen).readings).all()


def test_looks_along_a_push_are_at_whole_time_steps_near_their_moments() -> None:
    rig = Rig([force("object_1", 0)], [position("object_1", 0)])
    calls = rig.along(2.0, (0.102, 0.2, 0.2001))
    assert [asked.tool for asked in calls] == ["apply_force", *(["step", "get_position"] * 3)]
    waits = [asked.arguments["duration"] for asked in calls if asked.tool == "step"]
    assert waits == pytest.approx([0.1, 0.1, 0.005])
