"""Tests that the last read positions of objects follow from the calls and their results."""

from typing import Any

import pytest

from physment_mcp.contract.last_read import read_after

PLACE = [0.25, 0.0, 0.5]


@pytest.mark.parametrize(
    ("tool", "arguments", "content"),
    [
        ("get_position", {"object_id": "object_1"}, {"position": PLACE, "angle": None}),
        ("move_object", {"object_id": "1"}, {"position": PLACE}),
        ("change_position", {"object_id": 1}, {"new_position": PLACE}),
        ("find_objects", {}, {"revealed": [{"object_id": "object_1", "position": PLACE}]}),
    ],
)
def test_a_call_that_returns_a_place_is_the_last_reading(tool: str, arguments: Any, content: Any) -> None:
    earlier = {"object_1": {"position": [9, 9, 9], "angle": 2.0, "time": 0}, "object_2": {"position": PLACE, "time": 0}}
    found = read_after(earlier, tool, arguments, {"sim_time": 1.2, **content})
    assert found == {"object_1": {"position": PLACE, "time": 1.2}, "object_2": earlier["object_2"]}


def test_an_angle_that_was_returned_is_kept_zero_too() -> None:
    found = read_after({}, "get_position", {"object_id": "1"}, {"sim_time": 0, "position": PLACE, "angle": 0.0})
    assert found == {"object_1": {"position": PLACE, "angle": 0.0, "time": 0}}


@pytest.mark.parametrize(
    ("tool", "content"),
    [
        ("step", {"sim_time": 2}),
        ("get_velocity", {"sim_time": 2, "velocity": PLACE}),
        ("get_displacement", {"sim_time": 2, "displacement": PLACE}),
        ("get_position", {"sim_time": 2, "position": None}),
        ("get_position", {"position": PLACE}),
        ("find_objects", {"sim_time": 2, "revealed": [{"object_id": "object_2", "position": None}]}),
    ],
)
def test_other_calls_change_nothing(tool: str, content: Any) -> None:
    earlier = {"object_1": {"position": PLACE, "time": 1}}
    assert read_after(earlier, tool, {"object_id": "object_1"}, content) == earlier


def test_a_deleted_object_is_forgotten_with_what_went_with_it() -> None:
    earlier = {name: {"position": PLACE, "time": 1} for name in ("a", "b", "c")}
    found = read_after(
        earlier, "delete_objects", {"object_id": "a"}, {"sim_time": 2, "object_id": "a", "also_deleted": ["b"]}
    )
    assert set(found) == {"c"}
