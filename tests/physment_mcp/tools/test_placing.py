"""Tests of placing objects and of their shapes: positions, displacements, bounding boxes, rotation matrices."""

import math

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.builders.bench import ball_mjcf, open_bench

quick = settings(max_examples=50, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
TURNED = (
    '<body name="object_1" pos="0 0 1" euler="0 0 90"><joint type="free"/><geom type="box" size="0.1 0.2 0.3"/></body>'
)
SLIDE = '<body name="object_1" pos="0 0 1"><joint type="slide" axis="{axis}" {more}/><geom size="0.1"/></body>'


async def test_a_free_body_goes_where_it_is_put_and_keeps_its_motion() -> None:
    start = '<keyframe><key name="start" qpos="0 0 1 1 1 0 0" qvel="1 2 3 4 5 6"/></keyframe>'
    lab = open_bench(TURNED, start)
    before = await lab("get_position", object_id=1)
    velocity, spin = await lab.velocity(1), await lab.vector("get_angular_momentum", 1, mass=1)
    told = await lab("move_object", object_id=1, x=3, y=-4, z=13)
    assert told == {"sim_time": 0, "position": [3, -4, 13], "note": None}
    after = await lab("get_position", object_id=1)
    assert after["position"] == [3, -4, 13]
    assert after["orientation"] == before["orientation"]
    assert np.array_equal(await lab.velocity(1), velocity)
    assert np.array_equal(await lab.vector("get_angular_momentum", 1, mass=1), spin)
    assert await lab.number("get_displacement", 1) == pytest.approx(13, rel=1e-15)


async def test_a_shift_follows_the_world_or_the_body() -> None:
    lab = open_bench(TURNED)
    told = await lab("change_position", object_id=1, dx=1, dy=2, dz=3)
    assert told["new_position"] == pytest.approx([1, 2, 4], abs=1e-15)
    told = await lab("change_position", object_id=1, dx=1, dy=0, dz=0, in_world_frame=False)
    assert told["new_position"] == pytest.approx([1, 3, 4], abs=1e-12)  # its x axis is the world's y axis
    told = await lab("change_position", object_id=1, dx=0, dy=1, dz=1, in_world_frame=False)
    assert told["new_position"] == pytest.approx([0, 3, 5], abs=1e-12)


async def test_a_sliding_body_goes_as_near_as_its_axis_allows_and_says_so() -> None:
    lab = open_bench(SLIDE.format(axis="3 0 4", more=""))
    told = await lab("move_object", object_id=1, x=1, y=5, z=1)
    assert told["position"] == pytest.approx([0.36, 0, 1.48], abs=1e-12)
    assert "slides" in told["note"]
    told = await lab("change_position", object_id=1, dx=0.3, dy=0, dz=0.4)
    assert told["new_position"] == pytest.approx([0.66, 0, 1.88], abs=1e-12)
    assert told["note"] is None


async def test_a_slide_stops_at_the_ends_of_its_range() -> None:
    lab = open_bench(SLIDE.format(axis="1 0 0", more='limited="true" range="-0.2 0.5"'))
    told = await lab("move_object", object_id=1, x=9, y=0, z=1)
    assert told["position"] == pytest.approx([0.5, 0, 1], abs=1e-12)
    assert "range" in told["note"]
    told = await lab("change_position", object_id=1, dx=-9, dy=0, dz=0)
    assert told["new_position"] == pytest.approx([-0.2, 0, 1], abs=1e-12)


async def test_three_slides_reach_every_place() -> None:
    slides = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in ("1 0 0", "1 1 0", "0 1 1"))
    lab = open_bench(f'<body name="object_1" pos="0 0 1">{slides}<geom size="0.1"/></body>')
    told = await lab("move_object", object_id=1, x=1, y=-2, z=3)
    assert told["position"] == pytest.approx([1, -2, 3], abs=1e-12)
    assert told["note"] is None


@pytest.mark.parametrize("joint", ["hinge", "ball"])
async def test_an_object_that_can_only_turn_is_not_moved(joint: str) -> None:
    lab = open_bench(f'<body name="object_1"><joint type="{joint}"/><geom size="0.1" pos="0 0 -0.5"/></body>')
    assert "no free or sliding joint" in await lab.refused("move_object", object_id=1, x=1, y=0, z=0)
    assert "no free or sliding joint" in await lab.refused("change_position", object_id=1, dx=1, dy=0, dz=0)


async def test_jointed_children_ride_along() -> None:
    lab = open_bench(
        '<body name="object_1" pos="0 0 1"><joint type="free"/><geom size="0.1"/>'
        '<body name="object_2" pos="0 0 -0.5"><joint type="hinge" axis="0 1 0"/><geom size="0.1"/></body></body>'
    )
    await lab("step", duration=0.1)
    apart = await lab.position(2) - await lab.position(1)
    await lab("move_object", object_id=1, x=5, y=6, z=7)
    assert await lab.position(2) - [5, 6, 7] == pytest.approx(apart, abs=1e-12)
    for number in (1, 2):
        assert "call step first" in await lab.refused("get_acceleration", object_id=number)


@pytest.mark.parametrize(("gap", "fits"), [(-0.0009, True), (0.0, True), (-0.0011, False), (-0.15, False)])
async def test_a_place_is_refused_if_it_overlaps_by_more_than_a_millimetre(*, gap: float, fits: bool) -> None:
    lab = open_bench(ball_mjcf(1, "0 0 5") + ball_mjcf(2, "3 0 5") + ball_mjcf(3, "0 8 5", joint=""))
    for y, other in ((0, "object_2"), (8, "object_3")):
        x = (3 if y == 0 else 0) - 0.2 - gap
        if fits:
            await lab("move_object", object_id=1, x=x, y=y, z=5)
        else:
            assert f"overlap {other}" in await lab.refused("move_object", object_id=1, x=x, y=y, z=5)
            refused = await lab.refused("change_position", object_id=1, dx=x, dy=y, dz=0)
            assert f"overlap {other}" in refused


async def test_a_child_that_rides_along_must_fit_too() -> None:
    lab = open_bench(
        '<body name="object_1" pos="0 0 5"><joint type="free"/><geom size="0.1"/>'
        '<body name="object_2" pos="1 0 0"><joint type="hinge" axis="0 1 0"/><geom size="0.1"/></body></body>'
        + ball_mjcf(3, "3 0 5")
    )
    assert "overlap object_3" in await lab.refused("move_object", object_id=1, x=2, y=0, z=5)


async def test_what_overlaps_already_may_be_moved_out_and_not_further_in() -> None:
    lab = open_bench(ball_mjcf(1, "0 0 5") + ball_mjcf(2, "0.15 0 5"))
    assert "overlap" in await lab.refused("change_position", object_id=1, dx=0.01, dy=0, dz=0)
    assert await lab.position(1) == pytest.approx([0, 0, 5])
    await lab("change_position", object_id=1, dx=-0.01, dy=0, dz=0)
    assert await lab.position(1) == pytest.approx([-0.01, 0, 5])
    await lab("change_position", object_id=1, dx=-1, dy=0, dz=0)
    assert await lab.position(1) == pytest.approx([-1.01, 0, 5])


async def test_soft_surfaces_may_be_sunk_into_from_either_side() -> None:
    lab = open_bench(ball_mjcf(1, "0 0 5") + ball_mjcf(2, "3 0 5"), soft=("object_2",))
    await lab("move_object", object_id=1, x=2.9, y=0, z=5)
    await lab("change_position", object_id=2, dx=-0.05, dy=0, dz=0)
    created = await lab("create_objects", name="p", pos=[2.95, 0, 5.15], density=10, rgba=[1, 1, 1, 1], radius=0.05)
    places = [await lab.position(number) for number in (1, 2, created["object_id"])]
    assert places == [pytest.approx(place) for place in ([2.9, 0, 5], [2.95, 0, 5], [2.95, 0, 5.15])]


async def test_an_obstacle_that_was_moved_is_in_the_way_where_it_is_now() -> None:
    lab = open_bench(
        ball_mjcf(1, "0 0 5") + '<body name="object_2" mocap="true" pos="3 0 5"><geom size="0.1"/></body>',
        '<keyframe><key name="start" qpos="0 0 5 1 0 0 0" mpos="6 0 5"/></keyframe>',
    )
    assert await lab.position(2) == pytest.approx([6, 0, 5])
    assert "overlap object_2" in await lab.refused("move_object", object_id=1, x=6, y=0, z=5)
    await lab("move_object", object_id=1, x=3, y=0, z=5)
    await lab("create_objects", name="p", pos=[0, 0, 9], density=10, rgba=[1, 1, 1, 1])
    assert await lab.position(2) == pytest.approx([6, 0, 5])


async def test_displacement_of_a_created_ball_counts_from_where_it_was_created() -> None:
    lab = open_bench(TURNED)
    await lab("step", duration=0.5)
    await lab("create_objects", name="p", pos=[3, 0, 4], density=10, rgba=[1, 1, 1, 1])
    assert await lab.number("get_displacement", "p") == 0
    await lab("step", duration=0.2)
    assert await lab.number("get_displacement", "p") == pytest.approx(9.81 * 0.02, rel=1e-9)
    assert await lab.number("get_displacement", 1) == pytest.approx(9.81 * 0.49 / 2, rel=1e-9)


MESH = '<asset><mesh name="tetra" vertex="0 0 0  0.3 0 0  0 0.6 0  0 0 0.9"/></asset>'


@pytest.mark.parametrize(
    ("geom", "kind", "box"),
    [
        ('type="sphere" size="0.1"', "sphere", [0.2, 0.2, 0.2]),
        ('type="sphere" size="0.1" pos="1 2 3"', "sphere", [0.2, 0.2, 0.2]),
        ('type="box" size="0.1 0.2 0.3"', "box", [0.2, 0.4, 0.6]),
        ('type="box" size="0.1 0.2 0.3" euler="0 0 90"', "box", [0.4, 0.2, 0.6]),
        ('type="box" size="0.1 0.1 0.3" euler="0 0 45"', "box", [0.2 * 2**0.5, 0.2 * 2**0.5, 0.6]),
        ('type="cylinder" size="0.1 0.3"', "cylinder", [0.2, 0.2, 0.6]),
        ('type="cylinder" size="0.1 0.3" euler="0 90 0"', "cylinder", [0.6, 0.2, 0.2]),
        ('type="cylinder" size="0.1 0.3" euler="0 30 0"', "cylinder", [0.3 + 0.1 * 3**0.5, 0.2, 0.3 * 3**0.5 + 0.1]),
        ('type="capsule" size="0.1 0.3"', "capsule", [0.2, 0.2, 0.8]),
        ('type="capsule" size="0.1 0.3" euler="0 30 0"', "capsule", [0.5, 0.2, 0.2 + 0.3 * 3**0.5]),
        ('type="ellipsoid" size="0.1 0.2 0.3"', "ellipsoid", [0.2, 0.4, 0.6]),
        ('type="ellipsoid" size="0.1 0.2 0.3" euler="0 0 90"', "ellipsoid", [0.4, 0.2, 0.6]),
        ('type="ellipsoid" size="0.1 0.2 0.3" euler="0 0 45"', "ellipsoid", [0.1**0.5, 0.1**0.5, 0.6]),
    ],
)  # fmt: skip
async def test_a_bounding_box_holds_full_edges_in_the_body_frame(geom: str, kind: str, box: list[float]) -> None:
    lab = open_bench(
        f'<body name="object_1" pos="1 1 1" euler="20 30 40"><joint type="free"/><geom {geom} mass="2"/></body>'
    )
    seen = await lab("get_parameters", object_id=1)
    assert seen["type"] == kind
    assert seen["bounding_box"] == pytest.approx(box, rel=1e-9)
    assert seen["mass"] == pytest.approx(2, rel=1e-12)
    assert seen["withheld"] == []


async def test_a_compound_is_boxed_as_a_whole_and_planes_by_their_size() -> None:
    lab = open_bench(
        '<body name="object_1" pos="0 0 9"><joint type="free"/><geom size="0.1" mass="1" pos="-1 0 0"/>'
        '<geom type="box" size="0.1 0.2 0.3" mass="3" pos="1 0 0.5"/></body>'
        '<body name="object_2"><geom type="plane" size="2 3 1"/></body>'
        '<body name="object_3"><geom type="plane" size="0 3 1"/></body>'
        '<body name="object_4"><site pos="0 0 0"/></body>'
        '<body name="object_5" pos="5 5 5"><joint type="free"/><geom type="mesh" mesh="tetra" mass="1"/></body>',
        MESH,
    )
    compound = await lab("get_parameters", object_id=1)
    assert compound["type"] == "compound"
    assert compound["bounding_box"] == pytest.approx([2.2, 0.4, 0.9], rel=1e-12)
    assert compound["mass"] == pytest.approx(4, rel=1e-12)
    floor = await lab("get_parameters", object_id=2)
    assert (floor["type"], floor["bounding_box"]) == ("plane", [4, 6, 0])
    endless = await lab("get_parameters", object_id=3)
    assert endless["bounding_box"] is None
    assert endless["withheld"] == []
    assert (await lab("get_parameters", object_id=4))["bounding_box"] is None
    mesh = await lab("get_parameters", object_id=5)
    assert mesh["type"] == "mesh"
    # Its frame is computed from the vertices, which the engine stores in single precision.
    assert mesh["bounding_box"] == pytest.approx([0.3, 0.6, 0.9], rel=1e-6)


parts = st.floats(-1e3, 1e3, allow_subnormal=False)
quaternions = st.tuples(parts, parts, parts, parts).filter(lambda q: max(map(abs, q)) > 1e-3)


@quick
@given(q=quaternions, v=st.tuples(parts, parts, parts))
async def test_a_rotation_matrix_is_orthonormal_right_handed_and_turns_vectors_like_its_quaternion(
    q: tuple[float, ...], v: tuple[float, ...]
) -> None:
    lab = open_bench(TURNED)
    matrix = np.array((await lab("quat_to_rot_matrix", q=list(q)))["rotation_matrix"])
    assert matrix @ matrix.T == pytest.approx(np.eye(3), abs=1e-14)
    assert np.linalg.det(matrix) == pytest.approx(1, abs=1e-14)
    # v' = v + 2 w (u × v) + 2 u × (u × v) for a unit quaternion (w, u).
    unit = np.array(q) / np.linalg.norm(q)
    turn = np.cross(unit[1:], v)
    expected = np.array(v) + 2 * unit[0] * turn + 2 * np.cross(unit[1:], turn)
    assert matrix @ v == pytest.approx(expected, abs=1e-11)
    negative = (await lab("quat_to_rot_matrix", q=[-part for part in q]))["rotation_matrix"]
    assert np.array(negative) == pytest.approx(matrix, abs=1e-15)


@pytest.mark.parametrize("size", [1e6, 1.0, 1e-200, 5e-324])
async def test_the_length_of_a_quaternion_does_not_matter(size: float) -> None:
    lab = open_bench(TURNED)
    matrix = (await lab("quat_to_rot_matrix", q=[size, 0, 0, size]))["rotation_matrix"]
    assert np.array(matrix) == pytest.approx(np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]]), abs=1e-15)


async def test_a_reading_of_orientation_turns_the_body_axes_into_the_world() -> None:
    lab = open_bench('<body name="object_1" pos="0 0 1" euler="0 0 30"><joint type="free"/><geom size="0.1"/></body>')
    q = (await lab("get_position", object_id=1))["orientation"]
    matrix = np.array((await lab("quat_to_rot_matrix", q=q))["rotation_matrix"])
    assert matrix[:, 0] == pytest.approx([math.cos(math.pi / 6), 0.5, 0], abs=1e-12)
