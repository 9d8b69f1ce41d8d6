"""Tests of the table of calls: it shows the returned values with their units."""

import json
import re
from typing import Any

from evaluator.records.episode import Turn
from evaluator.report.call_rows import CallRow, ShownValue, calls_of
from tests.builders.paths import ROOT
from tests.builders.records import refused, rejected, returned, skipped, turn


def rows(*turns: Turn) -> list[CallRow]:
    return [row for calls in calls_of(turns) for row in calls.rows]


def test_a_reading_is_shown_with_its_quantity_and_unit_and_what_is_not_shown_to_the_agent_is_left_out() -> None:
    content: dict[str, Any] = {
        "sim_time": 0.1,
        "position": [0.0, -0.5, 2.12345678901],
        "orientation": None,
        "angle": 1.5,
    }
    (row,) = rows(turn("", returned("get_position", content, object_id="object_1")))
    assert row.asked == "object_1"
    assert row.quantities == [ShownValue("position", "(0, -0.5, 2.12345679)", "m"), ShownValue("angle", "1.5", "rad")]
    assert row.said == ""


def test_components_become_one_vector() -> None:
    acceleration = returned("get_acceleration", {"sim_time": 0.0, "x": 0.0, "y": 1.0, "z": -9.81}, object_id=1)
    momentum = returned(
        "get_momentum", {"sim_time": 0.0, "momentum": {"x": 1.0, "y": 0.0, "z": 2.5}}, object_id=1, mass=2.0
    )
    first, second = rows(turn("", acceleration, momentum))
    assert first.quantities == [ShownValue("acceleration", "(0, 1, -9.81)", "m/s²")]
    assert second.asked == "object_1, with mass 2 kg"
    assert second.quantities == [ShownValue("momentum", "(1, 0, 2.5)", "kg·m/s")]


def test_times_are_rounded_and_shown_where_they_change_and_at_the_start_of_each_turn() -> None:
    step = returned(
        "step", {"sim_time": 0.30000000000000004, "steps": 60, "results": None}, duration=0.30000000000000004
    )
    look = returned("get_velocity", {"sim_time": 0.30000000000000004, "velocity": [0, 0, 0]}, object_id=1)
    found = calls_of([turn("", step, look, look), turn("", look)])
    assert [row.time for calls in found for row in calls.rows] == ["0.3", "", "", "0.3"]
    assert found[0].rows[0].asked == "0.3 s"
    assert found[0].rows[0].said == "60 time steps"
    assert (found[0].begin, found[1].begin) == (0.0, found[0].end)


def test_what_was_asked_for_is_not_repeated_and_what_was_really_obtained_is() -> None:
    force = [1.0, 0.0, 0.0]
    same = returned(
        "apply_force", {"status": "force set", "object_id": "object_1", "force": force}, object_id=1, force_vector=force
    )
    other = returned(
        "set_velocity", {"status": "velocity set", "velocity": [0.5, 0.0, 0.0]}, object_id=1, velocity_vector=force
    )
    first, second = rows(turn("", same, other))
    assert (first.asked, first.quantities, first.said) == ("object_1, (1, 0, 0) N", (), "force set")
    assert second.quantities == [ShownValue("velocity", "(0.5, 0, 0)", "m/s")]
    (energy,) = rows(turn("", returned("get_kinetic_energy", {"kinetic_energy": 2.0}, object_id=2, mass=2.0)))
    assert energy.quantities == [ShownValue("kinetic energy", "2", "J")]


def test_found_objects_are_named_one_by_one() -> None:
    ball = {"object_id": "object_2", "name": "ball", "radius": 0.1, "mass": None, "position": [0, 0, 1]}
    (some,) = rows(turn("", returned("find_objects", {"status": "done", "revealed": [ball]})))
    assert some.quantities == [ShownValue("found object_2 ball", "radius 0.1 m, position (0, 0, 1) m", "")]
    (none,) = rows(turn("", returned("find_objects", {"status": "done", "revealed": []})))
    assert none.quantities == [ShownValue("found", "nothing", "")]


def test_refusals_and_calls_that_were_not_run_say_what_the_agent_was_told_and_take_no_time() -> None:
    step = returned("step", {"sim_time": 1.0, "steps": 200}, duration=1.0)
    found = rows(
        turn("", step, refused("step", "too long", duration=99.0), rejected("fly"), skipped("step", duration=5))
    )
    assert [row.said for row in found] == ["200 time steps", "too long", "fits no schema", ""]
    assert [row.time for row in found] == ["1", "", "", ""]


def test_what_is_left_of_a_limited_laboratory_stands_above_the_table() -> None:
    step = returned(
        "step", {"sim_time": 1.0, "steps": 200, "lab_time_left": 59.00000001, "calls_left": 7}, duration=1.0
    )
    free = returned("step", {"sim_time": 2.0, "steps": 200, "lab_time_left": 58.0, "calls_left": None}, duration=1.0)
    assert [calls.left for calls in calls_of([turn("", step), turn("", free), turn("")])] == [
        "59 s of lab time and 7 calls",
        "58 s of lab time",
        "",
    ]


def test_a_return_that_is_no_json_is_shown_as_it_was() -> None:
    text = returned("get_position", {}, object_id=1).model_copy(update={"content": None, "text": "not JSON"})
    other = returned("get_position", {"speeds": {"a": [1, "b"]}}, object_id=1)
    first, second = rows(turn("", text, other))
    assert (first.quantities, first.said) == ((), "not JSON")
    assert second.quantities == [ShownValue("speeds", '{"a": [1, "b"]}', "")]


def test_every_unit_is_the_one_that_the_tools_publish() -> None:
    tools = json.loads((ROOT / "tests/physment_mcp/tools/tools.golden.json").read_text(encoding="utf-8"))
    checked = 0
    for tool in tools:
        for name, field in tool["outputSchema"]["properties"].items():
            unit = re.search(r"\[(\S+)\]", re.sub(r"\[[a-z, ]+, [a-z, ]+\]", "", field.get("description", "")))
            if (
                unit is None
                or name in {"sim_time", "revealed", "lab_time_left"}
                or field.get("type") in {"string", "boolean"}
            ):
                continue
            value = {"x": 1.0, "y": 1.0, "z": 1.0} if name in {"x", "y", "z"} else {name: 1.0}
            (row,) = rows(turn("", returned(tool["name"], value, object_id=1)))
            assert row.quantities[0].unit == unit[1], (tool["name"], name)
            checked += 1
    assert checked > 20
