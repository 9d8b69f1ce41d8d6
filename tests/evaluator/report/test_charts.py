"""Tests of charts: they show only values that the agent read, at the time of reading and the right position."""

import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from evaluator.records.episode import Exchange
from evaluator.report.call_rows import motion_charts
from evaluator.report.charts import LEFT, Point, Series, chart, ticks
from tests.builders.records import refused, returned, turn


def at(time: float, position: list[Any], body: Any = "object_1") -> Exchange:
    return returned("get_position", {"sim_time": time, "position": position}, object_id=body)


def charts(*exchanges: Exchange) -> list[Any]:
    return motion_charts([turn("", *exchanges)])


def test_objects_that_moved_are_drawn_and_objects_at_rest_are_not() -> None:
    found = charts(at(0, [0, 0, 2]), at(0, [1, 1, 1], 2), at(0.5, [0, 0, 1]), at(0.5, [1, 1, 1], "object_2"))
    assert [one.title for one in found] == ["object_1: position [m] against time [s]"]
    z = found[0].lines[2]
    assert (z.name, len(z.marks)) == ("z", 2)
    assert z.marks[0].y < z.marks[1].y  # a higher value is drawn higher


def test_1_and_object_1_are_the_same_object_and_a_reset_breaks_the_line() -> None:
    (one,) = charts(at(0, [0, 0, 2], 1), at(1, [0, 0, 1]), at(0, [0, 0, 2]), at(2, [0, 0, 0]))
    assert [path.count(",") for path in one.lines[2].paths] == [2, 2]


def test_if_returns_hold_no_time_the_durations_of_steps_are_added_up() -> None:
    step = returned("step", {"result": "ok"}, duration=0.25)
    speeds = [returned("get_kinetic_energy", {"kinetic_energy": value}, object_id=1) for value in (0.0, 1.0, 4.0)]
    (one,) = charts(speeds[0], step, speeds[1], step, speeds[2])
    assert one.lines[0].name == "kinetic"
    assert [tick.label for tick in one.x_ticks][-1] == "0.6"
    assert [mark.x for mark in one.lines[0].marks] == pytest.approx([46.0, 148.5, 251.0])  # 246 px for 0.6 s


def test_the_angle_of_a_hinge_and_its_speed_are_drawn() -> None:
    def read(time: float, angle: float | None) -> list[Exchange]:
        position = {"sim_time": time, "position": [0, 0, 1], "orientation": None, "angle": angle}
        speed = {"sim_time": time, "velocity": [0, 0, 0], "angular_velocity": angle}
        return [returned("get_position", position, object_id=1), returned("get_velocity", speed, object_id=1)]

    found = charts(*read(0, 0.0), *read(1, 0.5))
    assert [one.title.split(" against")[0] for one in found] == [
        "object_1: angle [rad]",
        "object_1: angular velocity [rad/s]",
    ]
    assert found[1].lines[0].name == "angular velocity"
    assert charts(*read(0, None), *read(1, None)) == []


def test_errors_and_malformed_returns_are_not_drawn() -> None:
    failed = refused("get_position", "no such", object_id=1)
    odd: list[list[Any]] = [[0, 0], ["a", "b", "c"], [0, 0, True], [1e300, 0, 0]]
    assert charts(failed, *(at(time, position) for time, position in enumerate(odd))) == []
    assert charts(at(0, [0, 0, 1], ["object_1"]), at(1, [0, 0, 0], ["object_1"])) == []


def test_of_many_objects_those_read_most_are_drawn() -> None:
    exchanges = [at(time, [0, 0, time], body) for body in range(1, 12) for time in range(2 + (body == 9))]
    found = charts(*exchanges)
    assert len(found) == 6
    assert any(one.title.startswith("object_9:") for one in found)


@given(st.floats(-1e6, 1e6), st.floats(0, 1e6))
def test_ticks_are_round_ascend_and_cover_the_range(low: float, width: float) -> None:
    found = ticks(low, low + width)
    assert 2 <= len(found) <= 7
    assert found == sorted(set(found))
    slack = 1e-6 * max(abs(low), abs(low + width), 1e-3)
    assert found[0] <= low + slack
    assert found[-1] >= low + width - slack


@given(st.lists(st.tuples(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3)), min_size=1, max_size=20))
def test_every_mark_lies_inside_its_chart(values: list[tuple[float, float]]) -> None:
    drawn = chart("t", [Series("a", [[Point(x, y) for x, y in values]])])
    for mark in drawn.lines[0].marks:
        assert math.isfinite(mark.x)
        assert LEFT - 0.1 <= mark.x <= drawn.width
        assert 0 <= mark.y <= drawn.height


def test_shares_are_labelled_in_per_cent_and_series_are_drawn_apart() -> None:
    point = Point(5, 0.5, 0.25, 0.75)
    drawn = chart(
        "t", [Series("a", [[point]]), Series("b", [[point]])], x_ticks=[5, 20], y_range=(0, 1), dodge=4, percent=True
    )
    assert [tick.label for tick in drawn.x_ticks] == ["5", "20"]
    assert [tick.label for tick in drawn.y_ticks][-1] == "100 %"
    a, b = (line.marks[0] for line in drawn.lines)
    assert b.x - a.x == pytest.approx(4)
    assert a.low is not None
    assert a.high is not None
    assert a.low > a.y > a.high
