"""Tests for leaks: canaries are planted in a pack and searched for in everything that is published.

Where a private value could leak in another form, two packs that differ only in this value must publish the same.
"""

import json
import re
from typing import Any

import pytest
from mcp_types import PromptReference

from scenes import CANARY
from tests.builders.bench import PUBLIC
from tests.builders.laboratory import OpenLab

IDS = [f"object_{number}" for number in range(1, 10)]

# Without gravity and motion, positions keep these digits, so a leaked position is recognised at any time.
XML = """
<mujoco>
  <option timestep="0.005" integrator="RK4" cone="elliptic" impratio="10" gravity="0 0 0"/>
  <worldbody>
    <body name="object_1" pos="0 0 1">
      <joint name="j1" type="free"/><geom type="sphere" size="0.1" density="1000"/>
    </body>
    <body name="object_2" pos="1 0 1">
      <joint name="j2" type="free"/><geom type="box" size="0.1 0.2 0.3" density="500"/>
      <body name="object_9" pos="-0.3141592 -0.2718281 -0.5161803">
        <joint name="j9" type="slide" axis="0 0 1"/><geom type="sphere" size="0.0577215" mass="0.5772156"/>
      </body>
    </body>
    <body name="object_3"><geom type="plane" size="50 50 0.1"/></body>
    <body name="object_5" pos="31.41592 -27.18281 16.18033">
      <joint name="j5" type="free"/>
      <geom name="g5" type="sphere" size="0.1414213" mass="1.732050" rgba="0 0 0 0"/>
    </body>
    <body name="object_6" pos="-0.2345678 6.0000001 1.0765432">
      <joint name="j6" type="free"/>
      <geom name="g6" type="box" size="0.1234567 0.1345678 0.1456789" mass="7.6543219" quat="0.9 0.3 0.2 0.1"/>
    </body>
    <body name="object_7" pos="5 0 3">
      <joint name="j7" type="hinge" axis="0 1 0"/><geom type="sphere" pos="0 0 -0.5" size="0.1" mass="8.8776655"/>
    </body>
  </worldbody>
  <keyframe><key name="unused" time="0"/></keyframe>
</mujoco>
"""
FORBIDDEN = (
    "canary", CANARY, "76.5432123", "8.6420864",  # the answer and the accepted wording
    "31.4159", "27.1828", "16.1803", "0.14142", "0.28284", "1.73205",  # the hidden ball
    "0.31415", "0.27182", "0.51618", "0.05772", "0.11544", "0.57721", "0.685840", "0.4838",  # the hidden child
    "0.23456", "6.0000001", "1.07654", "0.12345", "0.13456", "0.14567", "0.24691", "0.26913", "0.29135",  # masked
    "7.65432", "8.87766",  # withheld masses
    "ghost", "stowaway", "object_5", "object_9",
)  # fmt: skip


def canary_pack() -> dict[str, Any]:
    public = dict(PUBLIC)
    permissions: dict[str, Any] = {f"object_{number}_permissions": public for number in (1, 2, 3)}
    for number in (5, 9):
        permissions[f"object_{number}_permissions"] = public | {"hidden": True}
    permissions["object_6_permissions"] = {"velocity": False, "secret_key": "canary-permission"}
    permissions["object_7_permissions"] = public | {"body_mass": False, "geom_density": False}
    names = {1: "ball", 2: "box", 3: "floor", 5: "ghost", 6: "black box", 7: "pendulum", 9: "stowaway"}
    return {
        "metadata": {
            "scene_name": "Leaks",
            "task": "Which is heavier?",
            "problem_type": "calculation",
            "description": "canary-description",
            "notes": "canary-notes",
        },
        "answer": 76.5432123,
        "expected_behavior": "canary-behaviour",
        "reasoning": "canary-reasoning",
        "number_of_objects": 7,
        "objects": {f"object_{n}": {"name": name, "object_id": str(n), "x": "canary-x"} for n, name in names.items()},
        "object_permissions": permissions,
        "category": "easy-multi-hidden",
        "concepts": ["canary-concept"],
        "answer_spec": {
            "kind": "number", "unit": "kg", "accept": ["canary-accept", r"8\.6420864"], "abs_tol": 8.6420864,
            "rel_tol": 0.086420864,
        },
        "disabled_tools": {"get_torque": "canary-reason"},
        "requires": ["canary-requires"],
        "knobs": {
            "canary_knob": {"canonical": 1.732050, "uniform": [1, 2], "meaning": "canary-meaning"},
            "weight": {"canonical": 7.6543219, "uniform": [3, 9], "meaning": "canary-meaning"},
            "turn": {"canonical": 0.9, "uniform": [0.5, 0.8]},
            "far": {"canonical": 31.41592, "uniform": [20, 40]},
        },
        "derive": {"canary_derived": "canary_knob * 2"},
        "accept_draw": ["canary_knob > 0"],
        "apply": {
            "geom[g5].mass": "canary_knob",
            "geom[g6].mass": "weight",
            "geom[g6].quat": ["turn", 0.3, 0.2, 0.1],
            "body[object_5].pos": ["far", -27.18281, 16.18033],
        },
        "version": "canary-version",
        "canary": CANARY,
        "internal": {"note": "canary-internal"},
    }  # fmt: skip


def every_call() -> list[tuple[str, dict[str, Any]]]:
    """Return calls of most tools with every object, unknown, hidden and masked ones included. All loads are 0."""
    calls: list[tuple[str, dict[str, Any]]] = [("get_center_of_mass", {}), ("quat_to_rot_matrix", {"q": [1, 1, 0, 0]})]
    for object_id in [*IDS, "ghost", "stowaway", "world", "object_77"]:
        alone = {"object_id": object_id}
        weighed = {"object_id": object_id, "mass": 1}
        calls += [
            *((name, alone) for name in ("get_position", "get_velocity", "get_acceleration", "get_torque")),
            *((name, alone) for name in ("get_parameters", "get_displacement")),
            *((name, weighed) for name in ("compute_force", "get_kinetic_energy", "get_potential_energy")),
            *((name, weighed) for name in ("get_rotational_energy", "get_momentum", "get_angular_momentum")),
            ("apply_force", alone | {"force_vector": [0, 0, 0]}),
            ("apply_torque", alone | {"torque_vector": [0, 0, 0]}),
            ("set_velocity", alone | {"velocity_vector": [0, 0, 0]}),
            ("change_position", alone | {"dx": 0, "dy": 0, "dz": 0}),
            ("change_position", alone | {"dx": 0, "dy": 0, "dz": 0, "in_world_frame": False}),
            ("apply_force", alone | {"force_vector": [0, 0]}),
        ]
        calls += [("detect_collision", {"obj1_id": object_id, "obj2_id": other}) for other in IDS]
        calls += [
            ("detect_collision", {"obj1_id": object_id, "obj2_id": other, "elastic_response": False}) for other in IDS
        ]
    calls += [
        ("attach_objects", {"object1_id": "object_1", "object2_id": "object_5"}),
        ("attach_objects", {"object1_id": "object_9", "object2_id": "object_1"}),
        ("delete_objects", {"object_id": "object_5"}),
        ("delete_objects", {"object_id": "object_9"}),
        ("delete_objects", {"object_id": "object_2"}),  # its child is hidden
        ("move_object", {"object_id": "object_1", "x": 0, "y": 6, "z": 1}),  # into the masked box
        ("move_object", {"object_id": "object_6", "x": 0, "y": 0, "z": 1}),
        ("create_objects", {"name": "object_5", "pos": [9, 9, 9], "density": 1, "rgba": [1, 1, 1, 1]}),
        ("create_objects", {"name": "object_9", "pos": [9, 9, 9], "density": 1, "rgba": [1, 1, 1, 1]}),
        ("create_objects", {"name": "p1", "pos": [0, 6, 1], "density": 1, "rgba": [1, 1, 1, 1]}),
        ("create_objects", {"name": "p2", "pos": [0, 6, 0.5], "density": 1, "rgba": [1, 1, 1, 1], "radius": 0.45}),
        ("no_such_tool", {"object_id": "object_5"}),
    ]
    return calls


async def published(lab: Any) -> list[str]:
    """Return everything that an agent can obtain without advancing the time, call by call."""
    client = lab.client
    texts = [client.instructions or "", (await client.list_tools()).model_dump_json()]
    texts.append((await client.list_prompts()).model_dump_json())
    for prompting in ("zero-shot", "one-shot-cot", "few-shot-cot"):
        for protocol in ("native", "text"):
            options = {"prompting": prompting, "protocol": protocol, "budget": "10"}
            texts.append((await client.get_prompt("scene", options)).model_dump_json())
    texts.append((await client.list_resources()).model_dump_json())
    uris = ("physment://scene", "physment://episode")
    texts += [(await client.read_resource(uri)).contents[0].text for uri in uris]
    for argument in ("scene_id", "prompting", "protocol", "budget", "seed", "object_id", "answer"):
        offered = await client.complete(PromptReference(name="scene"), {"name": argument, "value": ""})
        texts.append(offered.model_dump_json())
    for tool, arguments in every_call():
        texts.append((await client.call_tool(tool, arguments)).model_dump_json())
    return texts


def leaks(texts: list[str]) -> list[tuple[str, str]]:
    """Return the canaries in published data, except ids that the call itself contained."""
    found = []
    for text in texts:
        cleaned = re.sub(r"there is no object '[^']*'|the name '[^']*' is reserved", "", text)
        found += [(canary, text) for canary in FORBIDDEN if canary in cleaned]
    return found


async def test_nothing_published_contains_the_private_half(open_lab: OpenLab) -> None:
    async with open_lab(canary_pack(), XML) as lab:
        before = await published(lab)
        await lab.call("step", duration=0.01)
        after = await published(lab)
    assert not leaks(before)
    assert not leaks(after)


async def test_the_answer_tool_does_not_reveal_whether_the_answer_is_right(open_lab: OpenLab) -> None:
    told = []
    for answer in (76.5432123, -1.0, "canary-accept"):
        async with open_lab(canary_pack(), XML) as lab:
            told.append(await lab.call("answer", answer=answer))
            told.append(await lab.refused("answer", answer=answer))
    assert told[:2] == told[2:4] == told[4:]


async def test_what_is_hidden_stays_withheld_after_it_is_found(open_lab: OpenLab) -> None:
    pack = canary_pack()
    pack["object_permissions"]["object_5_permissions"] = {"hidden": True, "geom_type": True}
    async with open_lab(pack, XML) as lab:
        found = await lab.call("find_objects")
        assert [item["object_id"] for item in found["revealed"]] == ["object_5", "object_9"]
        ghost = found["revealed"][0]
        assert ghost["type"] == "sphere"
        assert {key for key, value in ghost.items() if value is not None} == {"object_id", "name", "type"}
        assert await lab.call("find_objects") == found
        for tool in ("get_position", "get_displacement"):
            assert "withheld" in await lab.refused(tool, object_id="object_5")


async def test_seeds_that_differ_in_private_values_publish_the_same_at_the_start(open_lab: OpenLab) -> None:
    transcripts = []
    for seed in (0, 1, 2):
        async with open_lab(canary_pack(), XML, seed=seed) as lab:
            transcripts.append(await published(lab))
    assert transcripts[0] == transcripts[1] == transcripts[2]


SPINNING = """
<mujoco>
  <option timestep="0.005" gravity="0 0 0"/>
  <worldbody>
    <body name="object_1" pos="0 0 1">
      <joint name="j1" type="free"/><geom type="box" size="0.1 0.2 0.3" mass="{mass}" quat="0.9 0.3 0.2 0.1"/>
    </body>
  </worldbody>
  <keyframe><key name="start" qpos="0 0 1 1 0 0 0" qvel="1 2 3 4 5 6"/></keyframe>
</mujoco>
"""


def one_object(**permissions: bool) -> dict[str, Any]:
    pack = canary_pack()
    pack.update(
        objects={"object_1": {"name": "thing", "object_id": "1"}}, knobs={}, derive={}, accept_draw=[], apply={}
    )
    pack["object_permissions"] = {"object_1_permissions": permissions}
    pack["disabled_tools"] = {}
    return pack


async def test_energies_and_momenta_do_not_reveal_the_true_mass(open_lab: OpenLab) -> None:
    transcripts = []
    for mass in (2.0, 8.0):  # powers of two, so that scaling rounds nothing
        async with open_lab(one_object(body_pos=True), SPINNING.format(mass=mass)) as lab:
            transcripts.append(
                [
                    await lab.call(tool, object_id=1, mass=3)
                    for tool in (
                        "get_kinetic_energy", "get_potential_energy", "get_rotational_energy", "get_momentum",
                        "get_angular_momentum",
                    )
                ]
            )  # fmt: skip
            assert "no movable object whose mass" in await lab.refused("get_center_of_mass")
    assert transcripts[0][2]["rotational_energy"] > 1
    flat = [re.findall(r"[-\d.e]+", json.dumps(transcript)) for transcript in transcripts]
    assert [float(a) for a in flat[0] if a[-1].isdigit()] == pytest.approx(
        [float(b) for b in flat[1] if b[-1].isdigit()], rel=1e-12
    )


async def test_a_local_shift_does_not_reveal_a_withheld_orientation(open_lab: OpenLab) -> None:
    async with open_lab(one_object(body_pos=True), SPINNING.format(mass=1)) as lab:
        assert (await lab.call("get_position", object_id=1))["orientation"] is None
        shift = {"object_id": 1, "dx": 0.5, "dy": 0, "dz": 0}
        assert "orientation" in await lab.refused("change_position", **shift, in_world_frame=False)
        await lab.call("change_position", **shift)


PARENT = """
<mujoco>
  <option timestep="0.005" gravity="0 0 0"/>
  <worldbody>
    <body name="object_2" pos="0 0 1">
      <joint name="j2" type="free"/><geom type="sphere" size="0.1"/>
      <body name="object_1" pos="1 0 0">
        <joint name="j1" type="hinge" axis="0 1 0"/><geom type="sphere" size="0.1" pos="0 0 -0.5"/>
      </body>
    </body>
  </worldbody>
  <keyframe><key name="start" qpos="0 0 1 1 0 0 0 0" qvel="0 1.2345 0 0 0 0 0"/></keyframe>
</mujoco>
"""


async def test_setting_a_velocity_does_not_reveal_a_withheld_one(open_lab: OpenLab) -> None:
    pack = one_object(velocity=False, body_pos=True)
    pack["objects"]["object_2"] = {"name": "carrier", "object_id": "2"}
    pack["object_permissions"]["object_2_permissions"] = {"velocity": False}
    async with open_lab(pack, PARENT) as lab:
        # At this moment the hinge moves object_1 along x only. Other components of its velocity would be the carrier's.
        told = await lab.call("set_velocity", object_id=1, velocity_vector=[1, 0, 0])
    assert told["velocity"] is None
    assert "1.2345" not in json.dumps(told)


TOUCHING = """
<mujoco>
  <option timestep="0.005" gravity="0 0 0"/>
  <worldbody>
    <body name="object_1" pos="0 0 1"><joint name="j1" type="free"/><geom type="sphere" size="0.1" mass="1"/></body>
    <body name="object_2" pos="0.1995 0 1">
      <joint name="j2" type="free"/><geom type="{kind}" size="0.1 0.1 0.1" mass="1"/>
    </body>
  </worldbody>
  <keyframe><key name="start" qpos="0 0 1 1 0 0 0 0.1995 0 1 1 0 0 0" qvel="1 0 0 0 0 0 0 0 0 0 0 0"/></keyframe>
</mujoco>
"""


@pytest.mark.parametrize(
    ("withheld", "kind", "null"),
    [
        ([], "sphere", set()),
        (["body_mass", "geom_density"], "sphere", {"impulse"}),
        (["velocity"], "sphere", {"approach_speed", "impulse"}),
        (["body_pos"], "sphere", {"contact_point", "normal", "approach_speed", "impulse"}),
        (["body_quat"], "box", {"normal", "approach_speed", "impulse"}),
        (["body_quat"], "sphere", set()),
        (["body_quat", "geom_type"], "sphere", {"normal", "approach_speed", "impulse"}),
    ],
)
async def test_a_collision_shows_only_what_both_objects_show(
    open_lab: OpenLab, withheld: list[str], kind: str, null: set[str]
) -> None:
    pack = one_object(**PUBLIC)
    pack["objects"]["object_2"] = {"name": "other", "object_id": "2"}
    pack["object_permissions"]["object_2_permissions"] = PUBLIC | dict.fromkeys(withheld, False)
    for elastic in (False, True):
        for first, second in ((1, 2), (2, 1)):
            async with open_lab(pack, TOUCHING.format(kind=kind)) as lab:
                seen = await lab.call("detect_collision", obj1_id=first, obj2_id=second, elastic_response=elastic)
            assert seen["collision_detected"]
            expected = null if elastic else null | {"impulse"}
            assert {key for key, value in seen.items() if value is None} == expected


async def test_a_refused_overlap_does_not_reveal_its_depth(open_lab: OpenLab) -> None:
    sentences = set()
    for place in ("0.5 0 1", "0.53217 0 1"):
        xml = TOUCHING.format(kind="sphere").replace("0.1995 0 1", place)
        pack = one_object(**PUBLIC)
        pack["objects"]["object_2"] = {"name": "other", "object_id": "2"}
        async with open_lab(pack, xml) as lab:
            sentences.add(await lab.refused("move_object", object_id=1, x=0.45, y=0, z=1))
            sphere = {"name": "probe", "pos": [0.45, 0, 1.05], "density": 1, "rgba": [1, 1, 1, 1]}
            sentences.add(
                (await lab.refused("create_objects", **sphere)).replace(
                    "probe was not created", "object_1 was not moved"
                )
            )
    assert len(sentences) == 1
    assert "overlap object_2" in sentences.pop()


async def test_placing_things_does_not_reveal_hidden_objects(open_lab: OpenLab) -> None:
    async with open_lab(canary_pack(), XML) as lab:
        on_ghost = {"x": 31.4, "y": -27.2, "z": 16.2}
        moved = await lab.call("move_object", object_id="object_1", **on_ghost)
        assert moved["position"] == [31.4, -27.2, 16.2]
        created = await lab.call(
            "create_objects", name="ghost", pos=[31.5, -27.3, 16.15], density=1, rgba=[1, 1, 1, 1], radius=0.01
        )
        assert created["object_id"] == "ghost"
        # There the hidden child of the box, 0.52 m below it, overlaps the floor.
        sunk = await lab.call("move_object", object_id="object_2", x=1, y=0, z=0.31)
        assert sunk["note"] is None


async def test_hidden_and_masked_objects_do_not_count_in_the_centre_of_mass(open_lab: OpenLab) -> None:
    async with open_lab(canary_pack(), XML) as lab:
        seen = await lab.call("get_center_of_mass")
    ball, box = 1000 * 4 / 3 * 3.141592653589793 * 0.1**3, 500 * 0.2 * 0.4 * 0.6
    assert seen["included"] == ["object_1", "object_2"]
    assert seen["excluded"] == ["object_6", "object_7"]
    assert seen["center_of_mass"]["x"] == pytest.approx(box / (ball + box), rel=1e-12)
    assert seen["center_of_mass"]["z"] == pytest.approx(1, rel=1e-12)
