"""Tests of contacts and elastic collisions: momentum and energy are conserved, also through joints and at walls."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tests.builders.bench import ball_mjcf, open_bench

NEAR = "0.1995 0 0"  # the surfaces of two balls of 0.1 m overlap by half a millimetre


async def momentum(lab: Any, masses: dict[Any, float]) -> np.ndarray:
    return sum(
        [await lab.vector("get_momentum", object_id, mass=m) for object_id, m in masses.items()], start=np.zeros(3)
    )


async def energy(lab: Any, masses: dict[Any, float]) -> float:
    kinds = ("get_kinetic_energy", "get_rotational_energy")
    return sum([await lab.number(kind, object_id, mass=m) for object_id, m in masses.items() for kind in kinds])


async def test_unequal_masses_exchange_velocities_as_in_the_textbook() -> None:
    m1, m2, u1, u2 = 1.0, 3.0, 2.0, -0.5
    lab = open_bench(ball_mjcf(1, "0 0 0", mass=m1) + ball_mjcf(2, NEAR, mass=m2), gravity="0 0 0")
    await lab("set_velocity", object_id=1, velocity_vector=[u1, 1, 0])
    await lab("set_velocity", object_id=2, velocity_vector=[u2, 0, 2])
    seen = await lab("detect_collision", obj1_id=1, obj2_id=2)
    assert seen["collision_detected"]
    assert seen["normal"] == pytest.approx([1, 0, 0], abs=1e-12)
    assert seen["contact_point"] == pytest.approx([0.09975, 0, 0], abs=1e-12)
    assert seen["approach_speed"] == pytest.approx(u1 - u2, rel=1e-12)
    assert seen["impulse"] == pytest.approx(2 * m1 * m2 / (m1 + m2) * (u1 - u2), rel=1e-12)
    v1 = ((m1 - m2) * u1 + 2 * m2 * u2) / (m1 + m2)
    v2 = ((m2 - m1) * u2 + 2 * m1 * u1) / (m1 + m2)
    assert await lab.velocity(1) == pytest.approx([v1, 1, 0], rel=1e-12, abs=1e-12)
    assert await lab.velocity(2) == pytest.approx([v2, 0, 2], rel=1e-12, abs=1e-12)
    again = await lab("detect_collision", obj1_id=2, obj2_id=1)
    assert again["impulse"] == 0  # they separate now
    assert again["approach_speed"] == pytest.approx(u2 - u1, rel=1e-12)
    assert again["normal"] == pytest.approx([-1, 0, 0], abs=1e-12)


async def test_looking_changes_nothing() -> None:
    lab = open_bench(ball_mjcf(1, "0 0 0") + ball_mjcf(2, NEAR), gravity="0 0 0")
    await lab("set_velocity", object_id=1, velocity_vector=[1, 0, 0])
    before = lab.fingerprint()
    seen = await lab("detect_collision", obj1_id=1, obj2_id=2, elastic_response=False)
    assert seen["approach_speed"] == pytest.approx(1)
    assert seen["impulse"] is None
    assert lab.fingerprint() == before


async def test_what_does_not_touch_does_not_bounce() -> None:
    lab = open_bench(ball_mjcf(1, "0 0 0") + ball_mjcf(2, "0.2001 0 0"), gravity="0 0 0")
    await lab("set_velocity", object_id=1, velocity_vector=[1, 0, 0])
    before = lab.fingerprint()
    seen = await lab("detect_collision", obj1_id=1, obj2_id=2)
    assert seen == {
        "sim_time": 0,
        "collision_detected": False,
        "contact_point": None,
        "normal": None,
        "approach_speed": None,
        "impulse": 0,
    }
    assert lab.fingerprint() == before


async def test_resting_contact_gets_no_impulse() -> None:
    lab = open_bench('<body name="object_2"><geom type="plane" size="5 5 1"/></body>' + ball_mjcf(1, "0 0 0.1"))
    await lab("step", duration=2)
    before = lab.fingerprint()
    seen = await lab("detect_collision", obj1_id=1, obj2_id=2)
    assert seen["collision_detected"]
    assert seen["impulse"] == 0
    assert lab.fingerprint() == before


async def test_a_ball_bounces_off_what_is_fixed_with_its_speed() -> None:
    wall = '<body name="object_2" pos="0.1995 0 0" euler="0 0 30"><geom type="box" size="0.1 5 5"/></body>'
    lab = open_bench(
        ball_mjcf(1, f"{0.1995 - 0.1995 * math.cos(math.pi / 6)} {-0.1995 / 2} 0", mass=2) + wall, gravity="0 0 0"
    )
    await lab("set_velocity", object_id=1, velocity_vector=[3, 0, 1])
    seen = await lab("detect_collision", obj1_id=1, obj2_id=2)
    normal = np.array([math.cos(math.pi / 6), 0.5, 0])
    assert seen["normal"] == pytest.approx(normal, abs=1e-9)
    assert seen["impulse"] == pytest.approx(2 * 2 * 3 * normal[0], rel=1e-9)
    mirrored = np.array([3, 0, 1]) - 2 * 3 * normal[0] * normal
    assert await lab.velocity(1) == pytest.approx(mirrored, abs=1e-9)


@pytest.mark.parametrize("joint", ["weld", "ball", "hinge"])
async def test_a_body_attached_behind_takes_part_in_a_head_on_collision(joint: str) -> None:
    # The blow passes through all three centres, so nothing turns, whatever the joint: m₁ meets m₂ + m₃.
    masses = {1: 1.0, 2: 2.0, 3: 5.0}
    lab = open_bench(ball_mjcf(1, "0 0 0", 1) + ball_mjcf(2, NEAR, 2) + ball_mjcf(3, "0.6 0 0", 5), gravity="0 0 0")
    axis = {"axis": [0, 0, 2]} if joint == "hinge" else {}
    await lab("attach_objects", object1_id=2, object2_id=3, joint=joint, **axis)
    await lab("set_velocity", object_id=1, velocity_vector=[4, 0, 0])
    seen = await lab("detect_collision", obj1_id=2, obj2_id=1)
    assert seen["impulse"] == pytest.approx(2 * 1 * 7 / 8 * 4, rel=1e-9)
    assert await lab.velocity(2) == pytest.approx([1, 0, 0], rel=1e-9, abs=1e-9)
    assert await lab.velocity(3) == pytest.approx([1, 0, 0], rel=1e-9, abs=1e-9)
    assert await momentum(lab, masses) == pytest.approx([4, 0, 0], rel=1e-9, abs=1e-9)
    assert await energy(lab, masses) == pytest.approx(8, rel=1e-9)


async def test_a_weld_makes_a_rigid_compound_that_also_turns() -> None:
    # A dumb-bell along y is hit along x at one end: 1/m_eff = 1/m + 1/M + s²/I with s the lever arm.
    lab = open_bench(ball_mjcf(1, "0 0 0", 1) + ball_mjcf(2, NEAR, 2) + ball_mjcf(3, "0.1995 1 0", 2), gravity="0 0 0")
    await lab("attach_objects", object1_id=3, object2_id=2)
    await lab("set_velocity", object_id=1, velocity_vector=[1, 0, 0])
    seen = await lab("detect_collision", obj1_id=1, obj2_id=2)
    inertia = 2 * 2 * 0.5**2 + 2 * 0.4 * 2 * 0.1**2
    impulse = 2 / (1 + 1 / 4 + 0.5**2 / inertia)
    assert seen["impulse"] == pytest.approx(impulse, rel=1e-9)
    spin = impulse * 0.5 / inertia
    assert await lab.velocity(2) == pytest.approx([impulse / 4 + 0.5 * spin, 0, 0], abs=1e-9)
    assert await lab.velocity(3) == pytest.approx([impulse / 4 - 0.5 * spin, 0, 0], abs=1e-9)
    assert await energy(lab, {1: 1, 2: 2, 3: 2}) == pytest.approx(0.5, rel=1e-9)


async def test_a_ring_of_welds_is_as_rigid_as_a_chain() -> None:
    impulses = []
    for pairs in (((2, 3), (3, 4)), ((2, 3), (3, 4), (4, 2))):
        lab = open_bench(
            ball_mjcf(1, "0 0 0", 1)
            + ball_mjcf(2, NEAR, 2)
            + ball_mjcf(3, "0.6 0.3 0", 3)
            + ball_mjcf(4, "0.6 -0.3 0.4", 4),
            gravity="0 0 0",
        )
        for first, second in pairs:
            await lab("attach_objects", object1_id=first, object2_id=second)
        await lab("set_velocity", object_id=1, velocity_vector=[1, 0, 0])
        impulses.append((await lab("detect_collision", obj1_id=1, obj2_id=2))["impulse"])
        assert await energy(lab, {1: 1, 2: 2, 3: 3, 4: 4}) == pytest.approx(0.5, rel=1e-9)
    assert impulses[1] == pytest.approx(impulses[0], rel=1e-9)


async def test_a_body_welded_to_what_is_fixed_does_not_give_way() -> None:
    lab = open_bench(
        ball_mjcf(1, "0 0 0", 1) + ball_mjcf(2, NEAR, 2) + ball_mjcf(3, "0.6 0 0", joint=""), gravity="0 0 0"
    )
    await lab("attach_objects", object1_id=2, object2_id=3)
    await lab("set_velocity", object_id=1, velocity_vector=[1, 0, 0])
    assert (await lab("detect_collision", obj1_id=1, obj2_id=2))["impulse"] == pytest.approx(2, rel=1e-9)
    assert await lab.velocity(1) == pytest.approx([-1, 0, 0], abs=1e-9)
    assert await lab.velocity(2) == pytest.approx([0, 0, 0], abs=1e-9)


async def test_a_body_welded_to_a_fixture_cannot_bounce_off_a_wall() -> None:
    lab = open_bench(
        ball_mjcf(1, "0 0 0") + ball_mjcf(2, NEAR, joint="") + ball_mjcf(3, "-0.6 0 0", joint=""), gravity="0 0 0"
    )
    await lab("attach_objects", object1_id=1, object2_id=3)
    await lab("set_velocity", object_id=1, velocity_vector=[1, 0, 0])
    assert "neither of the two can move" in await lab.refused("detect_collision", obj1_id=1, obj2_id=2)


async def test_many_bodies_elsewhere_do_not_change_a_collision() -> None:
    # With sixty or more degrees of freedom, the engine stores constraints in another format.
    impulses = []
    for others in (0, 20):
        lab = open_bench(
            ball_mjcf(1, "0 0 0", 1) + ball_mjcf(2, NEAR, 2) + ball_mjcf(3, "0.1995 1 0", 2), gravity="0 0 0"
        )
        await lab("attach_objects", object1_id=3, object2_id=2, joint="hinge", axis=[1, 1, 1])
        for number in range(others):
            await lab("create_objects", name=f"p{number}", pos=[number, 0, 9], density=10, rgba=[1, 1, 1, 1])
        await lab("set_velocity", object_id=1, velocity_vector=[1, 0, 0])
        impulses.append((await lab("detect_collision", obj1_id=1, obj2_id=2))["impulse"])
        assert await energy(lab, {1: 1, 2: 2, 3: 2}) == pytest.approx(0.5, rel=1e-9)
    assert impulses[1] == pytest.approx(impulses[0], rel=1e-9)


async def test_an_equality_of_the_scene_transmits_the_impulse() -> None:
    slide = '<joint name="s{}" type="slide" axis="1 0 0"/>'
    lab = open_bench(
        ball_mjcf(1, "0 0 0", 1)
        + ball_mjcf(2, NEAR, 2, joint=slide.format(2))
        + ball_mjcf(3, "0.2 3 0", 1, joint=slide.format(3)),
        '<equality><joint joint1="s3" joint2="s2" polycoef="0 2 0 0 0"/></equality>',
        gravity="0 0 0",
    )
    await lab("set_velocity", object_id=1, velocity_vector=[1, 0, 0])
    seen = await lab("detect_collision", obj1_id=1, obj2_id=2)
    # The geared ball moves twice as fast, so it adds 4 · 1 kg to the 2 kg.
    assert seen["impulse"] == pytest.approx(2 * 6 / 7, rel=1e-9)
    assert await lab.velocity(3) == pytest.approx(2 * await lab.velocity(2), abs=1e-9)


async def test_two_fixed_objects_and_a_guided_one_that_cannot_give_way_get_no_impulse() -> None:
    guided = ball_mjcf(1, "0 0 0", joint='<joint type="slide" axis="0 1 0"/>')
    lab = open_bench(guided + ball_mjcf(2, NEAR, joint=""), gravity="0 0 0")
    await lab("set_velocity", object_id=1, velocity_vector=[0, 1, 0])
    seen = await lab("detect_collision", obj1_id=1, obj2_id=2)
    assert seen["approach_speed"] == pytest.approx(0, abs=1e-12)
    assert seen["impulse"] == 0


async def test_a_multi_geom_pair_touches_by_any_of_its_geoms() -> None:
    fork = (
        '<body name="object_2" pos="1 0 0"><joint type="free"/><geom type="sphere" size="0.1" mass="1" pos="0 0.5 0"/>'
        '<geom type="sphere" size="0.1" mass="1" pos="-0.8005 0 0"/></body>'
    )
    lab = open_bench(ball_mjcf(1, "0 0 0") + fork, gravity="0 0 0")
    await lab("set_velocity", object_id=1, velocity_vector=[1, 0, 0])
    masses = {1: 1.0, 2: 2.0}
    before = await momentum(lab, masses), await energy(lab, masses)
    seen = await lab("detect_collision", obj1_id=1, obj2_id=2)
    assert seen["contact_point"] == pytest.approx([0.09975, 0, 0], abs=1e-9)
    assert await momentum(lab, masses) == pytest.approx(before[0], abs=1e-12)
    assert await energy(lab, masses) == pytest.approx(before[1], rel=1e-12)


speeds = st.floats(-5, 5, allow_subnormal=False)
vectors = st.tuples(speeds, speeds, speeds).map(list)


@settings(max_examples=40, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    masses=st.tuples(*[st.floats(0.1, 50)] * 3),
    velocities=st.tuples(vectors, vectors, vectors),
    joint=st.sampled_from([None, "weld", "ball", "hinge"]),
)
async def test_any_elastic_response_keeps_momentum_and_energy(masses: Any, velocities: Any, joint: str | None) -> None:
    lab = open_bench(
        ball_mjcf(1, "0 0 0", masses[0])
        + ball_mjcf(2, "0.15 0.1 0.08", masses[1])
        + ball_mjcf(3, "0.6 0.3 0", masses[2]),
        gravity="0 0 0",
    )
    weights = dict(enumerate(masses, 1))
    if joint is not None:
        axis = {"axis": [1, 2, 3]} if joint == "hinge" else {}
        await lab("attach_objects", object1_id=2, object2_id=3, joint=joint, **axis)
        velocities = (velocities[0], velocities[1], velocities[1])  # what is joined moves together
    for number, velocity in enumerate(velocities, 1):
        await lab("set_velocity", object_id=number, velocity_vector=velocity)
    before, work = await momentum(lab, weights), await energy(lab, weights)
    seen = await lab("detect_collision", obj1_id=1, obj2_id=2)
    assert await momentum(lab, weights) == pytest.approx(before, rel=1e-9, abs=1e-9)
    assert await energy(lab, weights) == pytest.approx(work, rel=1e-9, abs=1e-9)
    after = await lab("detect_collision", obj1_id=1, obj2_id=2, elastic_response=False)
    if seen["impulse"]:
        assert after["approach_speed"] == pytest.approx(-seen["approach_speed"], rel=1e-9, abs=1e-9)
