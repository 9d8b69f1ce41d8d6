"""Tests of creating, deleting, revealing and attaching: the edit is made, and everything else keeps its state."""

import math
from typing import Any

import numpy as np
import pytest

from physment_mcp.world.pictures.showing import ShownPart
from tests.builders.bench import Bench, ball_mjcf, open_bench

G = 9.81
SPHERE = {"pos": [0, 0, 9], "density": 1000, "rgba": [1, 0, 0, 1]}
# Everything that an edit could lose: a driven hinge, a spring, a tendon, an actuator with state, an inactive equality.
BUSY = """
<body name="object_1" pos="0 0 3"><joint name="swing" type="hinge" axis="0 1 0" stiffness="2"/>
  <geom size="0.1" mass="1" pos="0 0 -0.5"/>
  <body name="object_2" pos="0 0 -0.5"><joint name="tail" type="ball"/>
    <geom size="0.05" mass="1" pos="0 0.1 -0.3"/>
  </body>
</body>
<body name="object_3" pos="2 0 3"><joint name="free" type="free"/><geom type="box" size="0.1 0.2 0.3" mass="2"/></body>
<body name="object_4" pos="4 0 3"><joint name="lift" type="slide" axis="0 0 1"/><geom size="0.1" mass="1"/></body>
<body name="object_5" pos="6 0 0"><geom type="plane" size="9 9 1"/></body>
<body name="object_6" pos="6 0 0.1"><freejoint/><geom size="0.1" mass="1"/></body>
"""
BUSY_REST = """
<actuator>
  <general joint="lift" dyntype="integrator" gainprm="3" name="motor"/>
  <motor joint="swing" gear="2"/>
</actuator>
<equality>
  <joint joint1="lift" joint2="swing" active="false"/>
  <connect body1="object_3" body2="object_4" anchor="0 0 1"/>
</equality>
<keyframe><key name="start" qvel="1 0.1 0.2 0.3 1 2 3 3 2 1 0.5 0 0 0 0 0 0" act="0.7" ctrl="0.4 0.6"/></keyframe>
"""


async def motion(lab: Bench, ids: list[Any]) -> list[Any]:
    return [await lab(tool, object_id=one) for one in ids for tool in ("get_position", "get_velocity", "get_torque")]


async def busy() -> Bench:
    lab = open_bench(BUSY, BUSY_REST)
    await lab("apply_force", object_id=3, force_vector=[1, 2, 25])
    await lab("apply_torque", object_id=3, torque_vector=[0.1, 0.2, 0.3])
    await lab("apply_force", object_id=6, force_vector=[0.5, 0, 0])
    await lab("apply_torque", object_id=2, torque_vector=[0.1, 0, 0])
    await lab("step", duration=0.2)
    return lab


EDITS = {
    "create": [("create_objects", {"name": "p", **SPHERE})],
    "create and delete": [("create_objects", {"name": "p", **SPHERE}), ("delete_objects", {"object_id": "p"})],
    "find": [("find_objects", {})],
    "attach others": [
        ("create_objects", {"name": "p", **SPHERE}),
        ("create_objects", {"name": "q", **SPHERE, "pos": [0, 1, 9]}),
        ("attach_objects", {"object1_id": "p", "object2_id": "q"}),
    ],
}


@pytest.mark.parametrize("edits", EDITS.values(), ids=EDITS.keys())
async def test_an_edit_keeps_the_state_loads_and_clock_of_everything_else(edits: Any) -> None:
    ids = [1, 2, 3, 4, 6]
    lab, untouched = await busy(), await busy()
    before = await motion(lab, ids)
    for tool, arguments in edits:
        await lab(tool, **arguments)
    assert await motion(lab, ids) == before
    await lab("step", duration=0.5)
    await untouched("step", duration=0.5)
    # An edit may change the order of the equations, and the solver stops at a relative residual of 1e-8.
    for number in ids:
        assert await lab.position(number) == pytest.approx(await untouched.position(number), abs=1e-6)
        assert await lab.velocity(number) == pytest.approx(await untouched.velocity(number), abs=1e-5)
    assert await untouched.position(4) != pytest.approx([4, 0, 3], abs=0.01)


async def test_an_edit_keeps_what_readings_do_not_show() -> None:
    lab = await busy()

    def inner() -> tuple[Any, ...]:
        data = lab.session.world._data
        return (data.act.tolist(), data.ctrl.tolist(), data.eq_active.tolist()[:2], data.time)

    before = inner()
    assert before[0][0] > 0.7
    await lab("create_objects", name="p", **SPHERE)
    assert inner() == before
    await lab("attach_objects", object1_id="p", object2_id=6, joint="ball")
    assert inner() == before
    await lab("delete_objects", object_id="p")
    assert inner() == before
    await lab("delete_objects", object_id=3)
    assert inner()[0] == before[0]


async def test_a_created_ball_has_the_mass_of_its_density_and_is_free() -> None:
    lab = open_bench(BUSY, BUSY_REST.replace('qvel="1', 'qvel="0'))
    told = await lab("create_objects", name="probe-1", pos=[0, 1, 9], density=700, rgba=[0, 0.5, 1, 1], radius=0.2)
    assert told == {
        "sim_time": 0, "status": "created", "name": "probe-1", "object_id": "probe-1", "position": [0, 1, 9],
        "density": 700, "rgba": [0, 0.5, 1, 1],
    }  # fmt: skip
    seen = await lab("get_parameters", object_id="probe-1")
    assert seen["mass"] == pytest.approx(700 * 4 / 3 * math.pi * 0.2**3, rel=1e-12)
    assert seen["bounding_box"] == [0.4, 0.4, 0.4]
    assert (seen["type"], seen["withheld"]) == ("sphere", [])
    assert (await lab("get_position", object_id="probe-1"))["orientation"] == [1, 0, 0, 0]
    await lab("step", duration=0.5)
    assert await lab.velocity("probe-1") == pytest.approx([0, 0, -G / 2], rel=1e-9)
    assert "probe-1" in (await lab("get_center_of_mass"))["included"]


async def test_deleting_an_object_deletes_what_is_jointed_to_it_and_its_constraints() -> None:
    rest = """
    <tendon><spatial name="rope" limited="true" range="0 1"><site site="a"/><site site="b"/></spatial></tendon>
    <equality><weld body1="object_1" body2="object_3"/></equality>
    <actuator><motor tendon="rope"/></actuator>
    <sensor><tendonpos tendon="rope"/></sensor>
    """
    lab = open_bench(
        '<body name="object_1" pos="0 0 5"><joint type="free"/><geom size="0.1"/><site name="a"/>'
        '<body name="object_2" pos="0 0 -0.5"><joint type="hinge" axis="0 1 0"/><geom size="0.1"/></body></body>'
        '<body name="object_3" pos="0.5 0 5"><joint type="free"/><geom size="0.1" mass="2"/></body>'
        '<body name="object_4" pos="1 0 5"><joint type="free"/><geom size="0.1" mass="2"/><site name="b"/></body>',
        rest,
    )
    await lab("apply_torque", object_id=3, torque_vector=[1, 2, 3])
    await lab("step", duration=0.1)
    before = await motion(lab, [3, 4])
    told = await lab("delete_objects", object_id=1)
    assert (told["object_id"], told["also_deleted"]) == ("object_1", ["object_2"])
    assert await motion(lab, [3, 4]) == before
    for gone in (1, 2):
        assert "the objects you can use are object_3, object_4" in await lab.refused("get_position", object_id=gone)
    speed = await lab.velocity(4)
    await lab("step", duration=0.5)
    assert await lab.velocity(4) == pytest.approx(speed - [0, 0, G / 2], rel=1e-9, abs=1e-12)  # nothing holds it


@pytest.mark.parametrize("child", [{"hidden": True}, {"actuate": False}])
async def test_nothing_hidden_or_sealed_is_deleted_with_its_parent(child: dict[str, bool]) -> None:
    lab = open_bench(BUSY, BUSY_REST, permissions={2: child})
    assert await lab.refused("delete_objects", object_id=1) == "object_1 cannot be deleted in this scene"


async def test_a_name_is_free_again_after_deletion() -> None:
    lab = open_bench(BUSY, BUSY_REST)
    for _ in range(3):
        await lab("create_objects", name="p", **SPHERE)
        await lab("attach_objects", object1_id="p", object2_id=3)
        await lab("attach_objects", object1_id=4, object2_id="p", joint="ball")
        assert "attached" in await lab.refused("move_object", object_id=4, x=4, y=0, z=4)
        await lab("delete_objects", object_id="p")
        await lab("move_object", object_id=4, x=4, y=0, z=4)  # released


async def test_fixtures_and_statics_can_be_deleted() -> None:
    lab = open_bench(BUSY, BUSY_REST)
    await lab("delete_objects", object_id=5)
    await lab("step", duration=0.5)
    assert (await lab.position(6))[2] == pytest.approx(0.1 - G / 8, rel=1e-9)


async def test_finding_reveals_what_was_hidden_and_finding_again_returns_the_same() -> None:
    ghost = ball_mjcf(2, "1 0 5", geom='rgba="1 0 0 0"')
    lab = open_bench(ball_mjcf(1, "0 0 5") + ghost, permissions={2: {"hidden": True}})
    before = lab.session.world.save()
    first = await lab("find_objects")
    assert [item["object_id"] for item in first["revealed"]] == ["object_2"]
    assert first["revealed"][0]["mass"] == 1
    assert first["revealed"][0]["position"] == [1, 0, 5]
    assert await lab("find_objects") == first
    after = lab.session.world.save()
    assert (after.state.tobytes(), after.model) == (before.state.tobytes(), before.model)  # no recompile
    assert await lab.position("2") == pytest.approx([1, 0, 5])
    await lab("create_objects", name="p", **SPHERE)
    assert [part.rgba for part in shown(lab, "object_2")] == [[1, 0, 0, 1]]  # still opaque


async def test_a_find_that_is_rolled_back_leaves_hidden_objects_transparent() -> None:
    ghost = ball_mjcf(2, "1 0 5", geom='rgba="1 0 0 0"')
    lab = open_bench(ball_mjcf(1, "0 0 5") + ghost, permissions={2: {"hidden": True}})
    before, saved, state = lab.fingerprint(), lab.session.world.save(), lab.session.state
    lab.session.reveal()
    assert shown(lab, "object_2")
    lab.session.world.restore(saved)
    lab.session.state = state
    assert lab.fingerprint() == before
    assert not shown(lab, "object_2")
    await lab("create_objects", name="p", **SPHERE)  # compiles the model again
    assert not shown(lab, "object_2")


def shown(lab: Bench, body: str) -> list[ShownPart]:
    """Return the geoms of this body that are drawn; none if it is transparent."""
    return lab.session.world.shown_parts({body: "body"}, {(body, 0)}, {}).get(body, [])


async def test_finding_where_nothing_is_hidden_says_so() -> None:
    lab = open_bench(ball_mjcf(1, "0 0 5"))
    assert await lab("find_objects") == {"sim_time": 0, "status": "there is nothing hidden here", "revealed": []}


# Attaching. If the constrained point has the acceleration a, the engine's equalities yield by τ² a, where τ is one time
# step: 25e-6 s² · 3 g = 0.7 mm.
MILLIMETRE = 1e-3


async def gap(lab: Bench, first: Any, second: Any) -> np.ndarray:
    return await lab.position(second) - await lab.position(first)


@pytest.mark.parametrize("integrator", ["RK4", "Euler", "implicitfast"])
@pytest.mark.parametrize("joint", ["weld", "ball", "hinge"])
@pytest.mark.parametrize("mass", [0.05, 1, 5])
async def test_an_attachment_holds_a_swinging_weight_within_a_millimetre(
    joint: str, mass: float, integrator: str
) -> None:
    lab = open_bench(ball_mjcf(1, "0 0 5", joint="") + ball_mjcf(2, "0.5 0 5", mass), integrator=integrator)
    axis = {"axis": [0, 1, 0]} if joint == "hinge" else {}
    await lab("attach_objects", object1_id=2, object2_id=1, joint=joint, **axis)
    lowest = 5.0
    for _ in range(60):
        await lab("step", duration=0.025)
        apart = await gap(lab, 1, 2)
        lowest = min(lowest, apart[2])
        if joint == "weld":
            assert apart == pytest.approx([0.5, 0, 0], abs=MILLIMETRE)
        else:
            assert np.linalg.norm(apart) == pytest.approx(0.5, abs=MILLIMETRE)
    assert joint == "weld" or lowest < -0.49


@pytest.mark.parametrize("joint", ["weld", "ball", "hinge"])
async def test_an_attachment_holds_a_weight_pulled_up_at_three_g(joint: str) -> None:
    lab = open_bench(ball_mjcf(1, "0 0 5", mass=1) + ball_mjcf(2, "0.05 0 4.5", mass=5))
    axis = {"axis": [0, 1, 0]} if joint == "hinge" else {}
    await lab("attach_objects", object1_id=1, object2_id=2, joint=joint, **axis)
    await lab("apply_force", object_id=1, force_vector=[30, 0, 6 * G * 3])
    length = np.linalg.norm(await gap(lab, 1, 2))
    for _ in range(40):
        await lab("step", duration=0.025)
        assert np.linalg.norm(await gap(lab, 1, 2)) == pytest.approx(length, abs=MILLIMETRE)
    # The pair moves as one body: a = F/(m₁ + m₂) - g.
    centre = (await lab("get_center_of_mass"))["center_of_mass"]
    assert centre["z"] - (5 * 4.5 + 5) / 6 == pytest.approx(2 * G / 2, rel=1e-6)


async def test_a_welded_pair_is_one_rigid_body_under_a_torque() -> None:
    lab = open_bench(ball_mjcf(1, "0 0 0", mass=2) + ball_mjcf(2, "1 0 0", mass=2), gravity="0 0 0")
    await lab("attach_objects", object1_id=1, object2_id=2)
    await lab("apply_torque", object_id=1, torque_vector=[0, 0, 1])
    await lab("step", duration=0.5)
    inertia = 2 * 2 * 0.25 + 2 * 0.4 * 2 * 0.01
    speed = 0.5 * 0.5 / inertia  # v = ω/2, ω = τ t / I
    # The constraint transmits a force up to its impedance: all but 1 - d = 1e-3 of it.
    assert np.linalg.norm(await lab.velocity(2)) == pytest.approx(speed, rel=2e-3)
    assert await lab.velocity(1) == pytest.approx(-await lab.velocity(2), abs=1e-9)


async def test_a_ball_pivot_sits_at_the_second_objects_origin_and_lets_everything_turn() -> None:
    lab = open_bench(ball_mjcf(1, "0.5 0 5", mass=1) + ball_mjcf(2, "0 0 5", mass=1), gravity="0 0 0")
    await lab("attach_objects", object1_id=1, object2_id=2, joint="ball")
    await lab("apply_torque", object_id=2, torque_vector=[0, 0.01, 0])
    await lab("step", duration=0.2)
    # The second turns freely about its own centre, I = 2/5 m r²; the first is not affected.
    spin = await lab.vector("get_angular_momentum", 2, mass=1)
    assert spin == pytest.approx([0, 0.002, 0], abs=1e-9)
    assert await lab.velocity(1) == pytest.approx([0, 0, 0], abs=1e-9)


async def test_a_hinge_turns_about_its_axis_only() -> None:
    lab = open_bench(ball_mjcf(1, "0.5 0 5", mass=1) + ball_mjcf(2, "0 0 5", joint=""), gravity="0 0 0")
    await lab("attach_objects", object1_id=1, object2_id=2, joint="hinge", axis=[0, 1e-200, 0])
    await lab("apply_force", object_id=1, force_vector=[0, 3, 0])  # out of the plane in which it may swing
    await lab("step", duration=1)
    assert await lab.position(1) == pytest.approx([0.5, 0, 5], abs=MILLIMETRE)
    await lab("apply_force", object_id=1, force_vector=[0, 0, 1])
    await lab("step", duration=0.3)
    place = await lab.position(1)
    assert place[2] > 5.03
    assert np.linalg.norm(place - [0, 0, 5]) == pytest.approx(0.5, abs=MILLIMETRE)
    assert place[1] == pytest.approx(0, abs=MILLIMETRE)


async def test_overlapping_objects_are_attached_where_they_are_and_no_longer_collide() -> None:
    lab = open_bench(ball_mjcf(1, "0 0 5") + ball_mjcf(2, "0.05 0 5"), gravity="0 0 0")
    await lab("attach_objects", object1_id=1, object2_id=2)
    await lab("step", duration=1)
    assert await gap(lab, 1, 2) == pytest.approx([0.05, 0, 0], abs=1e-9)
    assert await lab.velocity(1) == pytest.approx([0, 0, 0], abs=1e-9)
    assert not (await lab("detect_collision", obj1_id=1, obj2_id=2))["collision_detected"]


async def test_attaching_what_is_too_far_away_for_the_engine_is_refused_and_names_nothing_of_the_model() -> None:
    lab = open_bench(ball_mjcf(1, "0 0 5") + ball_mjcf(2, "1 0 5"))
    await lab("move_object", object_id=1, x=0, y=0, z=1e6)
    told = await lab.refused("attach_objects", object1_id=1, object2_id=2)
    assert told == "the simulation would become unstable by this change; use smaller distances"
    await lab("move_object", object_id=1, x=0, y=0, z=7)
    await lab("attach_objects", object1_id=1, object2_id=2)


async def test_turned_and_moving_objects_are_attached_at_their_present_pose() -> None:
    lab = open_bench(
        '<body name="object_1" pos="0 0 0" euler="10 20 30"><joint type="free"/>'
        '<geom type="box" size="0.1 0.2 0.3" mass="1" pos="0.2 0 0"/></body>'
        '<body name="object_2" pos="1 1 0" euler="50 60 70"><joint type="free"/><geom size="0.1" mass="2"/></body>',
        '<keyframe><key name="start" qpos="0 0 0 1 0 0 0 1 1 0 0.5 0.5 -0.5 0.5" qvel="1 0 0 0.5 1 0 1 0 0 0 1 0.5"/>'
        "</keyframe>",
        gravity="0 0 0",
    )
    await lab("step", duration=0.3)
    readings = [await lab("get_position", object_id=n) for n in (1, 2)]
    await lab("attach_objects", object1_id=1, object2_id=2)
    assert [await lab("get_position", object_id=n) for n in (1, 2)] == readings

    async def relative() -> tuple[np.ndarray, np.ndarray]:
        turns = []
        for number in (1, 2):
            q = (await lab("get_position", object_id=number))["orientation"]
            turns.append(np.array((await lab("quat_to_rot_matrix", q=q))["rotation_matrix"]))
        return turns[0].T @ await gap(lab, 1, 2), turns[0].T @ turns[1]

    place, turn = await relative()
    # First the joint evens out their unequal spins, which lets it slip by Δv τ/e, with 1 m/s and 5 ms.
    await lab("step", duration=0.1)
    later = await relative()
    assert later[0] == pytest.approx(place, abs=2 * MILLIMETRE)
    await lab("step", duration=1)
    place_after, turn_after = await relative()
    assert place_after == pytest.approx(place, abs=MILLIMETRE)
    assert turn_after == pytest.approx(turn, abs=2 * MILLIMETRE)


async def test_an_attached_object_is_moved_neither_by_itself_nor_with_its_parent() -> None:
    lab = open_bench(
        '<body name="object_1" pos="0 0 5"><joint type="free"/><geom size="0.1"/>'
        '<body name="object_2" pos="1 0 0"><joint type="hinge" axis="0 1 0"/><geom size="0.1"/></body></body>'
        + ball_mjcf(3, "3 0 5")
    )
    await lab("attach_objects", object1_id=2, object2_id=3)
    for number in (1, 2, 3):
        assert "attached" in await lab.refused("move_object", object_id=number, x=0, y=5, z=5)
        assert "attached" in await lab.refused("change_position", object_id=number, dx=0, dy=0, dz=1)
    await lab("delete_objects", object_id=3)
    await lab("move_object", object_id=1, x=0, y=5, z=5)
    assert [await lab.position(number) for number in (1, 2)] == [pytest.approx([0, 5, 5]), pytest.approx([1, 5, 5])]


async def test_the_ropes_of_a_scene_do_not_hinder_moving() -> None:
    lab = open_bench(
        ball_mjcf(1, "0 0 5") + ball_mjcf(2, "1 0 5"),
        '<equality><connect body1="object_1" body2="object_2" anchor="0 0 0"/></equality>',
    )
    await lab("change_position", object_id=1, dx=0, dy=0.01, dz=0)
    assert await lab.position(1) == pytest.approx([0, 0.01, 5])
    assert await lab.position(2) == pytest.approx([1, 0, 5])
