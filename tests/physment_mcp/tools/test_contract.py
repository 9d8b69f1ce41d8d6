"""Tests of every tool through an MCP client: results, refusals, and that a refusal changes nothing."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from physment_mcp.serving.server import published_tools
from tests.builders.laboratory import OpenLab

ORDER = [
    "step",
    "get_position",
    "move_object",
    "change_position",
    "get_velocity",
    "set_velocity",
    "get_acceleration",
    "apply_force",
    "apply_torque",
    "get_torque",
    "get_parameters",
    "get_displacement",
    "compute_force",
    "get_kinetic_energy",
    "get_potential_energy",
    "get_rotational_energy",
    "get_momentum",
    "get_angular_momentum",
    "get_center_of_mass",
    "detect_collision",
    "quat_to_rot_matrix",
    "create_objects",
    "delete_objects",
    "find_objects",
    "attach_objects",
    "answer",
]

# A good call of each tool, in an order in which all succeed.
GOOD: dict[str, dict[str, Any]] = {
    "step": {"duration": 0.01},
    "get_position": {"object_id": "object_1"},
    "get_velocity": {"object_id": "object_1"},
    "get_acceleration": {"object_id": "object_1"},
    "compute_force": {"object_id": "object_1", "mass": 2},
    "get_torque": {"object_id": "object_1"},
    "get_parameters": {"object_id": "object_1"},
    "get_displacement": {"object_id": "object_1"},
    "get_kinetic_energy": {"object_id": "object_1", "mass": 2},
    "get_potential_energy": {"object_id": "object_1", "mass": 2},
    "get_rotational_energy": {"object_id": "object_1", "mass": 2},
    "get_momentum": {"object_id": "object_1", "mass": 2},
    "get_angular_momentum": {"object_id": "object_1", "mass": 2},
    "get_center_of_mass": {},
    "detect_collision": {"obj1_id": "object_1", "obj2_id": "object_2"},
    "quat_to_rot_matrix": {"q": [1, 0, 0, 0]},
    "move_object": {"object_id": "object_1", "x": 0, "y": 1, "z": 2},
    "change_position": {"object_id": "object_1", "dx": 0.1, "dy": 0, "dz": 0},
    "set_velocity": {"object_id": "object_1", "velocity_vector": [0, 0, 1]},
    "apply_force": {"object_id": "object_1", "force_vector": [1, 0, 0]},
    "apply_torque": {"object_id": "object_1", "torque_vector": [1, 0, 0]},
    "create_objects": {"name": "probe", "pos": [0, 3, 1], "density": 1000, "rgba": [1, 0, 0, 1]},
    "attach_objects": {"object1_id": "object_1", "object2_id": "object_2"},
    "find_objects": {},
    "delete_objects": {"object_id": "object_2"},
    "answer": {"answer": 1.0},
}
WITH_OBJECT = [name for name, arguments in GOOD.items() if "object_id" in arguments]
# Argument and index of every number that a tool takes.
NUMBERS = [
    (name, argument, index)
    for name, arguments in (GOOD | {"create_objects": GOOD["create_objects"] | {"radius": 0.1}}).items()
    for argument, value in arguments.items()
    if name != "answer" and not isinstance(value, str)
    for index in (range(len(value)) if isinstance(value, list) else [None])
] + [("get_potential_energy", "gravity", None), ("attach_objects", "axis", 1)]
NOT_NUMBERS = (math.nan, math.inf, -math.inf, True, "1", None, [1.0], {})
ACTUATIONS = [
    "move_object",
    "change_position",
    "set_velocity",
    "apply_force",
    "apply_torque",
    "delete_objects",
]  # of one object; attach and detect_collision take two


def put(arguments: dict[str, Any], argument: str, index: int | None, value: object) -> dict[str, Any]:
    if index is None:
        return {**arguments, argument: value}
    vector = list(arguments.get(argument, [0, 1, 0]))
    vector[index] = value
    return {**arguments, argument: vector}


async def test_the_26_tools_are_published_in_their_order(open_lab: OpenLab) -> None:
    async with open_lab() as lab:
        listed = await lab.client.list_tools()
        again = await lab.client.list_tools()
    assert [tool.name for tool in listed.tools] == ORDER
    assert len(ORDER) == 26
    assert listed.tools == again.tools
    assert sorted(GOOD) == sorted(ORDER)


async def test_published_schemas_match_the_golden_file(open_lab: OpenLab, *, update_goldens: bool) -> None:
    async with open_lab() as lab:
        listed = await lab.client.list_tools()
    published = [tool.model_dump(mode="json", by_alias=True, exclude_none=True) for tool in listed.tools]
    golden = Path(__file__).parent / "tools.golden.json"
    text = json.dumps(published, indent=1, ensure_ascii=False) + "\n"
    if update_goldens:
        golden.write_text(text, encoding="utf-8")
    assert golden.read_text(encoding="utf-8") == text, "if meant, remake it: pytest tests/contract --update-goldens"


@pytest.mark.parametrize("tool", published_tools(), ids=lambda tool: tool.name)
def test_every_tool_is_closed_described_and_annotated(tool: Any) -> None:
    jsonschema.Draft202012Validator.check_schema(tool.input_schema)
    jsonschema.Draft202012Validator.check_schema(tool.output_schema)
    assert tool.input_schema["additionalProperties"] is False
    assert tool.output_schema["additionalProperties"] is False
    assert "sim_time" in tool.output_schema["required"]
    assert tool.title
    assert len(tool.description) > 20
    hints = tool.annotations
    assert hints.title == tool.title
    assert hints.open_world_hint is False
    assert isinstance(hints.read_only_hint, bool)
    assert isinstance(hints.destructive_hint, bool)
    assert isinstance(hints.idempotent_hint, bool)
    reads = {name for name in ORDER if name.startswith("get_")} | {"compute_force", "quat_to_rot_matrix"}
    assert hints.read_only_hint == (tool.name in reads)
    assert hints.destructive_hint == (tool.name in {"delete_objects", "answer"})


def test_every_number_argument_is_bounded_in_its_published_schema() -> None:
    def numbers(schema: object, path: str) -> list[str]:
        if isinstance(schema, list):
            return [found for part in schema for found in numbers(part, path)]
        if not isinstance(schema, dict):
            return []
        loose = []
        if schema.get("type") == "number":
            low, high = {"minimum", "exclusiveMinimum"}, {"maximum", "exclusiveMaximum"}
            if not (low & schema.keys() and high & schema.keys()):
                loose.append(path)
        return loose + [found for key, part in schema.items() for found in numbers(part, f"{path}.{key}")]

    loose = [path for tool in published_tools() for path in numbers(tool.input_schema, tool.name)]
    assert all(path.startswith("answer.") for path in loose)  # an answer is taken verbatim


@pytest.mark.parametrize("mode", ["auto", "legacy"])
async def test_every_good_call_returns_what_its_schema_says(open_lab: OpenLab, mode: str) -> None:
    schemas = {tool.name: tool for tool in published_tools()}
    async with open_lab(mode=mode) as lab:
        for name, arguments in GOOD.items():
            jsonschema.validate(arguments, schemas[name].input_schema)
            result = await lab.client.call_tool(name, arguments)
            assert not result.is_error, (name, result.content)
            assert result.structured_content is not None
            jsonschema.validate(result.structured_content, schemas[name].output_schema or {})
            text = result.content[0].text
            assert json.loads(text) == result.structured_content
            assert text == json.dumps(result.structured_content, separators=(",", ":"), ensure_ascii=False)
            assert result.structured_content["sim_time"] == lab.session.world.time


async def test_ids_may_be_written_as_numbers_and_come_back_canonical(open_lab: OpenLab) -> None:
    async with open_lab() as lab:
        places = [await lab.call("get_position", object_id=object_id) for object_id in ("object_2", "2", 2)]
        pushed = await lab.call("apply_force", object_id=2, force_vector=[1, 0, 0])
        deleted = await lab.call("delete_objects", object_id="1")
    assert places[0] == places[1] == places[2]
    assert pushed["object_id"] == "object_2"
    assert deleted["object_id"] == "object_1"


@pytest.mark.parametrize("tool", WITH_OBJECT)
@pytest.mark.parametrize("unknown", ["object_99", "nobody", 5, "object_5", 0, -1, "world", "unnamed_bodies_0", "１"])
async def test_an_unknown_or_hidden_id_is_refused_with_the_ids_there_are(
    open_lab: OpenLab, tool: str, unknown: object
) -> None:
    async with open_lab() as lab:
        await lab.call("step", duration=0.01)
        sentence = await lab.refused(tool, **(GOOD[tool] | {"object_id": unknown}))
    known = "object_1, object_2, object_3, object_4, object_6, object_7, object_8, object_9"
    assert sentence == f"there is no object '{unknown}'; the objects you can use are {known}"


@pytest.mark.parametrize(
    ("tool", "first", "second"),
    [("attach_objects", "object1_id", "object2_id"), ("detect_collision", "obj1_id", "obj2_id")],
)
@pytest.mark.parametrize("unknown", [5, "object_5", "object_99"])
async def test_an_unknown_or_hidden_id_in_a_pair_is_refused(
    open_lab: OpenLab, tool: str, first: str, second: str, unknown: object
) -> None:
    async with open_lab() as lab:
        assert "there is no object" in await lab.refused(tool, **{first: "object_1", second: unknown})
        assert "there is no object" in await lab.refused(tool, **{first: unknown, second: "object_1"})


@pytest.mark.parametrize("name", ORDER)
async def test_an_argument_too_many_or_too_few_is_refused_by_name(open_lab: OpenLab, name: str) -> None:
    async with open_lab() as lab:
        assert "'extra'" in await lab.refused(name, **GOOD[name], extra=1)
        for argument in GOOD[name]:
            left = {key: value for key, value in GOOD[name].items() if key != argument}
            assert f"'{argument}' is missing" in await lab.refused(name, **left)


@pytest.mark.parametrize(("name", "argument", "index"), NUMBERS)
async def test_what_is_not_a_number_is_refused(open_lab: OpenLab, name: str, argument: str, index: int | None) -> None:
    async with open_lab() as lab:
        for wrong in NOT_NUMBERS:
            assert argument in await lab.refused(name, **put(GOOD[name], argument, index, wrong))


@pytest.mark.parametrize(("name", "argument", "index"), NUMBERS)
@pytest.mark.parametrize("too_big", [1.1e6, -1.1e6, 1e300, 10**400])
async def test_a_number_out_of_bounds_is_refused(
    open_lab: OpenLab, name: str, argument: str, index: int | None, too_big: float
) -> None:
    async with open_lab() as lab:
        assert argument in await lab.refused(name, **put(GOOD[name], argument, index, too_big))


@pytest.mark.parametrize(
    ("name", "argument"), sorted({(name, argument) for name, argument, index in NUMBERS if index is not None})
)
async def test_a_vector_of_the_wrong_length_is_refused(open_lab: OpenLab, name: str, argument: str) -> None:
    right = GOOD[name].get(argument, [0, 1, 0])
    async with open_lab() as lab:
        for wrong in ([], right[:-1], [*right, 0], dict(enumerate(right)), "[1, 2, 3]", 1.0):
            assert argument in await lab.refused(name, **(GOOD[name] | {argument: wrong}))


@pytest.mark.parametrize("name", ORDER)
async def test_after_the_answer_every_call_is_refused(open_lab: OpenLab, name: str) -> None:
    async with open_lab() as lab:
        assert await lab.call("answer", answer="first") == {"sim_time": 0.0, "acknowledged": True}
        assert (await lab.refused(name, **GOOD[name])).startswith("the episode is over")
        assert (await lab.refused(name, nonsense=1)).startswith("the episode is over")
        assert lab.session.state.answer == "first"


@pytest.mark.parametrize("name", ACTUATIONS)
async def test_a_sealed_object_is_not_acted_on(open_lab: OpenLab, name: str) -> None:
    async with open_lab() as lab:
        assert "sealed" in await lab.refused(name, **(GOOD[name] | {"object_id": "object_4"}))


async def test_a_sealed_object_is_neither_attached_nor_bounced(open_lab: OpenLab) -> None:
    async with open_lab() as lab:
        for pair in (("object_1", "object_4"), ("object_4", "object_1")):
            assert "sealed" in await lab.refused("attach_objects", object1_id=pair[0], object2_id=pair[1])
            assert "sealed" in await lab.refused("detect_collision", obj1_id=pair[0], obj2_id=pair[1])
            looked = await lab.call("detect_collision", obj1_id=pair[0], obj2_id=pair[1], elastic_response=False)
            assert looked["collision_detected"] is False
            assert looked["impulse"] is None


@pytest.mark.parametrize(
    ("name", "attribute"),
    [
        ("get_position", "position"),
        ("get_displacement", "position"),
        ("get_potential_energy", "position"),
        ("get_velocity", "velocity"),
        ("get_acceleration", "velocity"),
        ("compute_force", "velocity"),
        ("get_kinetic_energy", "velocity"),
        ("get_rotational_energy", "velocity"),
        ("get_momentum", "velocity"),
        ("get_angular_momentum", "velocity"),
    ],
)
async def test_a_withheld_attribute_is_not_read(open_lab: OpenLab, name: str, attribute: str) -> None:
    async with open_lab() as lab:
        await lab.call("step", duration=0.01)
        sentence = await lab.refused(name, **(GOOD[name] | {"object_id": "object_6"}))
    assert f"the {attribute} of object_6 is withheld" in sentence


async def test_withheld_parameters_are_null_and_named(open_lab: OpenLab) -> None:
    async with open_lab() as lab:
        seen = await lab.call("get_parameters", object_id=6)
    assert seen == {
        "sim_time": 0.0,
        "mass": None,
        "bounding_box": None,
        "type": None,
        "withheld": ["mass", "bounding_box", "type"],
    }


async def test_a_withheld_orientation_is_null_beside_a_permitted_position(
    open_lab: OpenLab, pack: dict[str, Any]
) -> None:
    pack["object_permissions"]["object_2_permissions"]["body_quat"] = False
    async with open_lab(pack) as lab:
        seen = await lab.call("get_position", object_id=2)
    assert seen == {"sim_time": 0.0, "position": [1.0, 0.0, 1.0], "orientation": None, "angle": None}


@pytest.mark.parametrize(
    ("permissions", "mass", "box"),
    [
        ({"body_mass": True}, True, False),
        ({"geom_density": True}, False, False),
        ({"geom_density": True, "geom_radius": True}, True, True),
        ({"geom_density": True, "geom_size": True}, True, True),
        ({"geom_radius": True}, False, True),
    ],
)
async def test_permission_of_density_and_size_is_permission_of_the_mass(
    open_lab: OpenLab, pack: dict[str, Any], permissions: dict[str, bool], *, mass: bool, box: bool
) -> None:
    pack["object_permissions"]["object_1_permissions"] = permissions
    async with open_lab(pack) as lab:
        seen = await lab.call("get_parameters", object_id=1)
    assert (seen["mass"] is not None) == mass
    assert (seen["bounding_box"] is not None) == box


@pytest.mark.parametrize("name", ORDER)
async def test_a_disabled_tool_stays_published_and_says_so(open_lab: OpenLab, pack: dict[str, Any], name: str) -> None:
    pack["disabled_tools"] = {name: "it would give the game away"}
    async with open_lab(pack) as lab:
        assert name in [tool.name for tool in (await lab.client.list_tools()).tools]
        assert await lab.refused(name, **GOOD[name]) == f"{name} is not available in this scene"
        assert f"Not available in this scene: {name}." in lab.instructions


@pytest.mark.parametrize("name", ["move_object", "change_position", "set_velocity", "apply_force", "apply_torque"])
async def test_what_is_fixed_is_not_acted_on(open_lab: OpenLab, name: str) -> None:
    async with open_lab() as lab:
        for fixed in ("object_3", "object_9"):
            assert "fixed" in await lab.refused(name, **(GOOD[name] | {"object_id": fixed}))
        assert "fixed" in await lab.refused("attach_objects", object1_id="object_3", object2_id="object_9")


async def test_a_tool_that_does_not_exist_is_an_error_result_with_the_names_there_are(
    open_lab: OpenLab,
) -> None:
    async with open_lab() as lab:
        sentence = await lab.refused("teleport", object_id="object_1")
    assert "'teleport'" in sentence
    assert all(name in sentence for name in ORDER)


@pytest.mark.parametrize("duration", [0, -1, 60.0001, 1e-320 * 0])
async def test_a_duration_out_of_range_is_refused(open_lab: OpenLab, duration: float) -> None:
    async with open_lab() as lab:
        assert "duration" in await lab.refused("step", duration=duration)


@pytest.mark.parametrize("mass", [0, -1])
@pytest.mark.parametrize("name", [name for name in ORDER if "mass" in GOOD[name]])
async def test_a_mass_to_compute_with_is_positive(open_lab: OpenLab, name: str, mass: float) -> None:
    async with open_lab() as lab:
        await lab.call("step", duration=0.01)
        assert "mass" in await lab.refused(name, object_id=1, mass=mass)


async def test_the_zero_quaternion_is_refused(open_lab: OpenLab) -> None:
    async with open_lab() as lab:
        assert "zero quaternion" in await lab.refused("quat_to_rot_matrix", q=[0, 0, 0, 0])
        assert "zero quaternion" in await lab.refused("quat_to_rot_matrix", q=[0, -0.0, 0, 0])


@pytest.mark.parametrize(
    "name",
    [
        "", "1", "1st", "a b", "a/b", "é", "x" * 41, "<b/>", 'a"b', "a&b", "_a", "a\n", "object_1", "object_50",
        "Object_2", "world", "object", "laboratory", "object_5", "object_ghost",
    ],
)  # fmt: skip
async def test_a_bad_or_reserved_name_is_refused(open_lab: OpenLab, name: str) -> None:
    async with open_lab() as lab:
        await lab.refused("create_objects", **(GOOD["create_objects"] | {"name": name}))


async def test_a_name_is_not_given_twice(open_lab: OpenLab) -> None:
    async with open_lab() as lab:
        await lab.call("create_objects", **GOOD["create_objects"])
        again = GOOD["create_objects"] | {"pos": [0, 6, 1]}
        assert "'probe' already" in await lab.refused("create_objects", **again)


@pytest.mark.parametrize(
    ("argument", "value"),
    [
        ("density", 0), ("density", -1), ("density", 100_001), ("radius", 0), ("radius", 0.0009), ("radius", 11),
        ("rgba", [1, 1, 1, 1.1]), ("rgba", [1, 1, 1, -0.1]), ("rgba", [1, 1, 1]), ("name", 5), ("name", None),
    ],
)  # fmt: skip
async def test_a_sphere_out_of_bounds_is_not_created(open_lab: OpenLab, argument: str, value: object) -> None:
    async with open_lab() as lab:
        assert argument in await lab.refused("create_objects", **(GOOD["create_objects"] | {argument: value}))


async def test_a_sphere_too_light_to_simulate_is_not_created(open_lab: OpenLab) -> None:
    async with open_lab() as lab:
        feather = GOOD["create_objects"] | {"density": 1e-5, "radius": 1e-3}
        assert "larger density or radius" in await lab.refused("create_objects", **feather)
        # I = 2/5 m r² = 1.6755 ρ r⁵ [kg·m²] must be above the engine's smallest number, 1e-15.
        await lab.call("create_objects", **(feather | {"density": 0.6}))


async def test_a_sphere_is_not_created_inside_something_visible(open_lab: OpenLab) -> None:
    async with open_lab() as lab:
        inside = await lab.refused("create_objects", **(GOOD["create_objects"] | {"pos": [0.1, 0, 1]}))
        assert "overlap object_1" in inside
        below = await lab.refused("create_objects", **(GOOD["create_objects"] | {"pos": [0, 3, 0.05]}))
        assert "overlap object_3" in below


async def test_no_more_than_64_objects_are_created(open_lab: OpenLab) -> None:
    async with open_lab() as lab:
        for index in range(64):
            await lab.call("create_objects", name=f"p{index}", pos=[index, 9, 1], density=1, rgba=[1, 1, 1, 1])
        assert "64" in await lab.refused("create_objects", **GOOD["create_objects"])
        await lab.call("delete_objects", object_id="p3")
        assert "64" in await lab.refused("create_objects", **GOOD["create_objects"])


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        ({"object2_id": "object_1"}, "itself"),
        ({"joint": "glue"}, "joint"),
        ({"joint": "hinge"}, "axis"),
        ({"joint": "hinge", "axis": [0, 0, 0]}, "axis"),
        ({"joint": "weld", "axis": [0, 0, 1]}, "axis"),
        ({"joint": "ball", "axis": [0, 0, 1]}, "axis"),
    ],
)
async def test_a_joint_that_makes_no_sense_is_refused(open_lab: OpenLab, arguments: dict[str, Any], word: str) -> None:
    async with open_lab() as lab:
        assert word in await lab.refused("attach_objects", **(GOOD["attach_objects"] | arguments))


async def test_attaching_twice_is_refused_in_either_order(open_lab: OpenLab) -> None:
    async with open_lab() as lab:
        await lab.call("attach_objects", **GOOD["attach_objects"])
        assert "already" in await lab.refused("attach_objects", object1_id="object_1", object2_id="object_2")
        assert "already" in await lab.refused("attach_objects", object1_id=2, object2_id=1, joint="ball")


async def test_an_object_does_not_collide_with_itself(open_lab: OpenLab) -> None:
    async with open_lab() as lab:
        assert "itself" in await lab.refused("detect_collision", obj1_id="1", obj2_id="object_1")


@pytest.mark.parametrize(
    "answer",
    ["", "text", "[1, 2, 3]", "3.50", 3, 3.5, -0.0, 10**30, [1, "a", 2.5], [], ["1"], [3, 3.0]],
    ids=repr,
)
async def test_an_answer_is_recorded_verbatim(open_lab: OpenLab, answer: object) -> None:
    async with open_lab() as lab:
        await lab.call("answer", answer=answer)
        assert repr(lab.session.state.answer) == repr(answer)


@pytest.mark.parametrize(
    "answer", [None, True, math.nan, math.inf, {"a": 1}, [[1]], [None], [math.nan], [True]], ids=repr
)
async def test_an_answer_of_the_wrong_form_is_refused_and_does_not_end_the_episode(
    open_lab: OpenLab, answer: object
) -> None:
    async with open_lab() as lab:
        await lab.refused("answer", answer=answer)
        await lab.call("answer", answer=1)


async def test_a_crash_in_the_laboratory_is_an_error_result_that_changes_and_reveals_nothing(
    open_lab: OpenLab, caplog: pytest.LogCaptureFixture
) -> None:
    async with open_lab() as lab:
        state = lab.session.state
        broken = replace(state.objects["object_2"], body="no such body")
        lab.session.state = replace(state, objects={**state.objects, "object_2": broken})
        before = lab.state()
        result = await lab.client.call_tool("get_parameters", {"object_id": "object_2"})
        assert result.is_error
        assert (
            result.content[0].text
            == "get_parameters failed inside the laboratory and was rolled back; try something else"
        )
        assert lab.state() == before
        await lab.call("get_position", object_id=1)
    assert "no such body" not in caplog.text
