"""Tests of motion against closed forms: falling, swinging, spinning, rolling, Atwood's machine.

Tolerances follow from the time step Δt. Under a constant force the engine's RK4 is exact up to rounding; oscillations
are accurate to order Δt⁴; motion with contacts depends on the softness of the contacts.
"""

import math

import numpy as np
import pytest

from tests.builders.bench import ball_mjcf, open_bench

G = 9.81
EXACT = 1e-9
"""Relative rounding error of some hundred steps."""


async def test_a_dropped_ball_falls_as_galileo_says() -> None:
    lab = open_bench(ball_mjcf(1, "0 0 30"))
    await lab("step", duration=0.8)
    assert await lab.velocity(1) == pytest.approx([0, 0, -G * 0.8], rel=EXACT)
    assert await lab.position(1) == pytest.approx([0, 0, 30 - G * 0.8**2 / 2], rel=EXACT)
    assert await lab.vector("get_acceleration", 1) == pytest.approx([0, 0, -G], rel=EXACT)
    assert await lab.vector("compute_force", 1, mass=2) == pytest.approx([0, 0, -2 * G], rel=EXACT)
    assert await lab.number("get_displacement", 1) == pytest.approx(G * 0.8**2 / 2, rel=EXACT)
    assert await lab.number("get_kinetic_energy", 1, mass=2) == pytest.approx((G * 0.8) ** 2, rel=EXACT)
    assert await lab.vector("get_momentum", 1, mass=2) == pytest.approx([0, 0, -2 * G * 0.8], rel=EXACT)
    assert await lab.number("get_potential_energy", 1, mass=2, gravity=3) == pytest.approx(
        6 * (30 - G * 0.8**2 / 2), rel=EXACT
    )
    assert await lab.number("get_rotational_energy", 1, mass=2) == 0


async def test_a_force_accelerates_by_newtons_second_law() -> None:
    lab = open_bench(ball_mjcf(1, "0 0 0", mass=2.5), gravity="0 0 0")
    await lab("apply_force", object_id=1, force_vector=[5, -10, 2.5])
    await lab("step", duration=0.4)
    assert await lab.velocity(1) == pytest.approx([0.8, -1.6, 0.4], rel=EXACT)
    assert await lab.vector("get_acceleration", 1) == pytest.approx([2, -4, 1], rel=EXACT)
    await lab("apply_force", object_id=1, force_vector=[0, 0, 0])
    await lab("step", duration=0.4)
    assert await lab.velocity(1) == pytest.approx([0.8, -1.6, 0.4], rel=EXACT)


OFFSET = """
<body name="object_1" pos="1 2 3" quat="0.9 0.1 0.3 0.2"><joint type="free"/>
  <geom type="sphere" size="0.1" mass="1" pos="0.5 0 0"/><geom type="sphere" size="0.1" mass="3" pos="0 0.4 0"/>
</body>
"""


async def test_a_force_acts_at_the_centre_of_mass_of_an_offset_body() -> None:
    lab = open_bench(OFFSET, gravity="0 0 0")
    await lab("apply_force", object_id=1, force_vector=[4, 8, 12])
    await lab("step", duration=0.5)
    assert await lab.velocity(1) == pytest.approx([0.5, 1, 1.5], rel=EXACT)
    # It does not turn; the tolerance is for rounding.
    assert await lab.vector("get_angular_momentum", 1, mass=4) == pytest.approx([0, 0, 0], abs=1e-12)
    assert await lab.number("get_displacement", 1) == pytest.approx(np.linalg.norm([1, 2, 3]) / 8, rel=EXACT)


async def test_the_height_in_potential_energy_is_that_of_the_centre_of_mass() -> None:
    lab = open_bench(OFFSET)
    w, x, y, z = np.array([0.9, 0.1, 0.3, 0.2]) / math.sqrt(0.95)
    # Bottom row of the rotation matrix on the centre of mass (0.125, 0.3, 0).
    height = 3 + 2 * (x * z - w * y) * 0.125 + 2 * (y * z + w * x) * 0.3
    assert await lab.number("get_potential_energy", 1, mass=4) == pytest.approx(4 * G * height, rel=EXACT)
    centre = (await lab("get_center_of_mass"))["center_of_mass"]
    assert centre["z"] == pytest.approx(height, rel=EXACT)


async def test_small_swings_of_a_pendulum_have_huygens_period() -> None:
    # A physical pendulum: I_pivot = m l² + 2/5 m r².
    length, radius, start = 0.5, 0.1, math.radians(2)
    lab = open_bench(
        f'<body name="object_1" pos="0 0 2" euler="0 {math.degrees(start)} 0"><joint type="hinge" axis="0 1 0"/>'
        f'<geom type="sphere" size="{radius}" mass="3" pos="0 0 {-length}"/></body>'
    )
    omega = math.sqrt(G * length / (length**2 + 0.4 * radius**2))
    period = 2 * math.pi / omega * (1 + start**2 / 16)
    times, speeds = [], []
    for _ in range(round(2.2 * period / 0.005)):
        speeds.append((await lab.velocity(1))[0])
        times.append((await lab("step", duration=0.005))["sim_time"] - 0.005)
    crossings = [
        times[i] + 0.005 * speeds[i] / (speeds[i] - speeds[i + 1])
        for i in range(1, len(times) - 1)
        if speeds[i] * speeds[i + 1] < 0
    ]
    # The error of linear interpolation of a sine is at most (ωΔt)²/8 of its amplitude, here 6e-5 of a period.
    assert 2 * (crossings[2] - crossings[1]) == pytest.approx(period, rel=2e-4)
    # Speed at the bottom from energy: ½ I ω² = m g l (1 - cos θ₀).
    bottom = omega * length * math.sqrt(2 * (1 - math.cos(start)))
    assert max(map(abs, speeds)) == pytest.approx(bottom, rel=(omega * 0.005) ** 2)


async def test_a_spring_stretches_by_hooke_and_swings_with_its_period() -> None:
    stiffness, mass = 40.0, 2.5
    lab = open_bench(
        '<body name="object_1" pos="0 0 1"><joint type="slide" axis="0 0 1" stiffness="40"/>'
        '<geom type="box" size="0.1 0.1 0.1" mass="2.5"/></body>'
    )
    omega = math.sqrt(stiffness / mass)
    stretch = mass * G / stiffness
    for _ in range(10):
        time = (await lab("step", duration=0.17))["sim_time"]
        expected = 1 - stretch * (1 - math.cos(omega * time))
        # The error of RK4 is (ωΔt)⁵/120 of the amplitude in a step, 2.7e-11, and there are some 350 steps.
        assert (await lab.position(1))[2] == pytest.approx(expected, abs=1e-7)


async def test_a_rolling_ball_is_slowed_by_its_inertia_and_a_shell_more() -> None:
    slope = math.radians(20)
    # A floor tilted about y; the balls touch it. A shell has 2/3 m r² instead of 2/5.
    up = (math.sin(slope), math.cos(slope))
    place = f"{0.1 * up[0]:.9f} {{y}} {0.1 * up[1]:.9f}"
    lab = open_bench(
        f'<body name="object_3" euler="0 20 0"><geom type="plane" size="50 50 1" friction="1 0 0"/></body>'
        f'<body name="object_1" pos="{place.format(y=0)}"><joint type="free"/>'
        '<geom type="sphere" size="0.1" mass="2" friction="1 0 0" condim="3"/></body>'
        f'<body name="object_2" pos="{place.format(y=1)}"><joint type="free"/>'
        f'<inertial pos="0 0 0" mass="2" diaginertia="{2 / 3 * 0.02} {2 / 3 * 0.02} {2 / 3 * 0.02}"/>'
        '<geom type="sphere" size="0.1" friction="1 0 0" condim="3"/></body>'
    )
    await lab("step", duration=1)
    for number, share in ((1, 2 / 5), (2, 2 / 3)):
        speed = np.linalg.norm(await lab.velocity(number))
        # Soft contacts slip a little: the engine's elliptic cone with impratio 10 regularises friction by d = 0.9…0.95.
        assert speed == pytest.approx(G * math.sin(slope) / (1 + share), rel=0.01)
        energy = await lab.number("get_rotational_energy", number, mass=2)
        assert energy == pytest.approx(share * await lab.number("get_kinetic_energy", number, mass=2), rel=0.02)


async def test_masses_tied_by_an_equality_move_like_atwoods() -> None:
    body = (
        '<body name="object_{n}" pos="{n} 0 5"><joint name="s{n}" type="slide" axis="0 0 1"/>'
        '<geom size="0.1" mass="{m}"/></body>'
    )
    lab = open_bench(
        body.format(n=1, m=3) + body.format(n=2, m=2),
        '<equality><joint joint1="s1" joint2="s2" polycoef="0 -1 0 0 0" solimp="0.9999 0.9999 0.001"/></equality>',
    )
    await lab("step", duration=1)
    # a = g (m₁ - m₂)/(m₁ + m₂); the equality does not transmit 1e-4 of its force (its impedance).
    assert await lab.vector("get_acceleration", 1) == pytest.approx([0, 0, -G / 5], rel=2e-3)
    assert await lab.velocity(2) == pytest.approx([0, 0, G / 5], rel=2e-3)
    total = await lab.vector("compute_force", 1, mass=3) + await lab.vector("compute_force", 2, mass=2)
    assert total[2] == pytest.approx(-G / 5, rel=4e-3)


BRICK = """
<body name="object_1" quat="0.8 0.2 -0.4 0.4"><joint type="free"/>
  <geom type="box" size="0.1 0.2 0.3" mass="6" quat="0.5 0.5 0.5 0.5"/>
</body>
"""


def brick_inertia() -> np.ndarray:
    """World inertia of BRICK: edges 0.2, 0.4, 0.6 along its geom's axes."""
    edges = np.array([0.2, 0.4, 0.6]) ** 2
    local = np.diag(6 / 12 * (edges.sum() - edges))

    def matrix(w: float, x: float, y: float, z: float) -> np.ndarray:
        v, cross = np.array([x, y, z]), np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        return (w * w - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * w * cross

    turn = matrix(0.8, 0.2, -0.4, 0.4) @ matrix(0.5, 0.5, 0.5, 0.5)
    return turn @ local @ turn.T


async def test_a_torque_spins_a_turned_brick_by_eulers_equations() -> None:
    lab = open_bench(BRICK, gravity="0 0 0", dt=1e-4)
    torque = np.array([0.3, -0.2, 0.5])
    await lab("apply_torque", object_id=1, torque_vector=torque.tolist())
    assert await lab.vector("get_torque", 1) == pytest.approx(torque, rel=1e-15)
    await lab("step", duration=0.01)
    momentum = torque * 0.01
    # L = τ t holds exactly; RK4 keeps it to order Δt⁴.
    assert await lab.vector("get_angular_momentum", 1, mass=6) == pytest.approx(momentum, rel=1e-6)
    # The brick has turned by some 1e-4 rad, and that changes E = ½ Lᵀ I⁻¹ L by as much.
    energy = momentum @ np.linalg.inv(brick_inertia()) @ momentum / 2
    assert await lab.number("get_rotational_energy", 1, mass=6) == pytest.approx(energy, rel=1e-3)


async def test_the_agents_mass_scales_spin_readings() -> None:
    lab = open_bench(BRICK, gravity="0 0 0")
    await lab("apply_torque", object_id=1, torque_vector=[0.3, -0.2, 0.5])
    await lab("step", duration=0.1)
    for tool in ("get_angular_momentum", "get_momentum"):
        assert await lab.vector(tool, 1, mass=12) == pytest.approx(2 * await lab.vector(tool, 1, mass=6), rel=1e-14)
    of_one_kilogram = await lab.number("get_rotational_energy", 1, mass=1)
    assert await lab.number("get_rotational_energy", 1, mass=7) == pytest.approx(7 * of_one_kilogram, rel=1e-14)


async def test_a_free_brick_keeps_its_angular_momentum_and_energy_while_it_tumbles() -> None:
    start = '<keyframe><key name="start" qpos="0 0 0 0.8 0.2 -0.4 0.4" qvel="0 0 0 1 2 3"/></keyframe>'
    drifts = []
    for dt in (2e-3, 1e-3):
        lab = open_bench(BRICK, start, gravity="0 0 0", dt=dt)
        momentum = await lab.vector("get_angular_momentum", 1, mass=6)
        energy = await lab.number("get_rotational_energy", 1, mass=6)
        assert energy > 1
        await lab("step", duration=2)
        after = await lab.vector("get_angular_momentum", 1, mass=6)
        # In the body's frame Euler's equations are integrated by RK4: (ωΔt)⁴ = 3e-9 at 2 ms, over some 4 rad.
        assert np.linalg.norm(after) == pytest.approx(np.linalg.norm(momentum), rel=1e-8)
        assert await lab.number("get_rotational_energy", 1, mass=6) == pytest.approx(energy, rel=1e-8)
        drifts.append(np.linalg.norm(after - momentum) / np.linalg.norm(momentum))
    # The engine turns orientations by one mean spin per step, which is accurate to second order: the drift is ~ Δt².
    assert drifts[0] < (4 * 2e-3) ** 2
    assert drifts[0] / drifts[1] == pytest.approx(4, rel=0.02)


DOUBLE = """
<body name="object_1" pos="0 0 3"><joint type="hinge" axis="0 1 0"/>
  <geom type="capsule" fromto="0 0 0 0.3 0 -0.4" size="0.02" mass="1"/>
  <body name="object_2" pos="0.3 0 -0.4"><joint type="hinge" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0.4 0 0.1" size="0.02" mass="2"/>
  </body>
</body>
"""


async def test_velocities_in_a_double_pendulum_are_those_of_its_centres_of_mass() -> None:
    lab = open_bench(DOUBLE, flags='<flag contact="disable"/>', dt=0.001)
    await lab("step", duration=0.4)
    world = lab.session.world
    for number in (1, 2):
        before, after = world.centre(f"object_{number}"), None
        speed = await lab.velocity(number)
        await lab("step", duration=0.001)
        after = world.centre(f"object_{number}")
        later = await lab.velocity(number)
        # The mean of both speeds is the mean velocity up to Δt² a''/12, some 1e-5 m/s at accelerations of 30 m/s².
        assert (after - before) / 0.001 == pytest.approx((speed + later) / 2, abs=1e-4)
        assert np.linalg.norm(speed) > 0.5


async def test_a_double_pendulum_keeps_its_energy() -> None:
    lab = open_bench(DOUBLE, flags='<flag contact="disable"/>', dt=0.001)

    async def energy() -> float:
        kinds = ("get_kinetic_energy", "get_potential_energy", "get_rotational_energy")
        return sum([await lab.number(kind, n, mass=m) for n, m in ((1, 1), (2, 2)) for kind in kinds])

    start = await energy()
    await lab("step", duration=1)
    # RK4 with ω ~ 10 rad/s: (ωΔt)⁴ = 1e-8 of energies of 100 J.
    assert await energy() == pytest.approx(start, abs=1e-5)


async def test_there_is_no_acceleration_before_a_step_or_after_a_disturbance() -> None:
    lab = open_bench(ball_mjcf(1, "0 0 5") + ball_mjcf(2, "1 0 5"))
    sphere = {"name": "p", "pos": [2, 0, 5], "density": 100, "rgba": [1, 1, 1, 1]}
    for tool, more in (("get_acceleration", {}), ("compute_force", {"mass": 1})):
        assert "call step first" in await lab.refused(tool, object_id=1, **more)
    await lab("step", duration=0.1)
    disturbances = [
        ("move_object", {"object_id": 1, "x": 0, "y": 0, "z": 6}),
        ("change_position", {"object_id": 1, "dx": 0, "dy": 0, "dz": 1}),
        ("set_velocity", {"object_id": 1, "velocity_vector": [0, 0, 1]}),
    ]
    for tool, arguments in disturbances:
        assert await lab.vector("get_acceleration", 1) == pytest.approx([0, 0, -G], rel=EXACT)
        await lab(tool, **arguments)
        assert "call step first" in await lab.refused("get_acceleration", object_id=1)
        # The other object was not disturbed.
        assert await lab.vector("get_acceleration", 2) == pytest.approx([0, 0, -G], rel=EXACT)
        await lab("step", duration=0.005)
    await lab("create_objects", **sphere)
    assert "call step first" in await lab.refused("get_acceleration", object_id="p")
    for number in (1, 2):
        assert await lab.vector("get_acceleration", number) == pytest.approx([0, 0, -G], rel=EXACT)
    await lab("attach_objects", object1_id=1, object2_id="p")
    await lab("delete_objects", object_id="p")
    assert await lab.vector("get_acceleration", 2) == pytest.approx([0, 0, -G], rel=EXACT)
    await lab("create_objects", **sphere)
    assert "call step first" in await lab.refused("get_acceleration", object_id="p")
    await lab("step", duration=0.005)
    assert await lab.vector("get_acceleration", "p") == pytest.approx([0, 0, -G], rel=EXACT)


async def test_acceleration_does_not_look_ahead() -> None:
    lab = open_bench(ball_mjcf(1, "0 0 5", mass=1))
    await lab("step", duration=0.1)
    await lab("apply_force", object_id=1, force_vector=[100, 0, 0])
    assert await lab.vector("get_acceleration", 1) == pytest.approx([0, 0, -G], rel=EXACT)
    await lab("step", duration=0.005)
    assert await lab.vector("get_acceleration", 1) == pytest.approx([100, 0, -G], rel=EXACT)


@pytest.mark.parametrize(
    ("name", "body", "asked", "obtained"),
    [
        ("free", '<joint type="free"/><geom size="0.1" mass="1"/>', [1, -2, 3], [1, -2, 3]),
        ("offset", '<joint type="free"/><geom size="0.1" mass="1" pos="0.3 0.2 0.1"/>', [1, -2, 3], [1, -2, 3]),
        ("slide", '<joint type="slide" axis="3 0 4"/><geom size="0.1" mass="1"/>', [1, 7, 0], [0.36, 0, 0.48]),
        (
            "two slides",
            '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="1 1 0"/><geom size="0.1" mass="1"/>',
            [1, -2, 3],
            [1, -2, 0],
        ),
        ("hinge", '<joint type="hinge" axis="0 1 0"/><geom size="0.1" mass="1" pos="0 0 -0.5"/>', [2, 5, 3], [2, 0, 0]),
        ("ball joint", '<joint type="ball"/><geom size="0.1" mass="1" pos="0 0 -0.5"/>', [2, 5, 3], [2, 5, 0]),
    ],
)
async def test_set_velocity_gives_the_nearest_velocity_the_joints_allow(
    name: str, body: str, asked: list[float], obtained: list[float]
) -> None:
    assert name
    lab = open_bench(f'<body name="object_1" pos="0 0 2">{body}</body>')
    told = await lab("set_velocity", object_id=1, velocity_vector=asked)
    assert told["velocity"] == pytest.approx(obtained, rel=1e-12, abs=1e-12)
    assert await lab.velocity(1) == pytest.approx(obtained, rel=1e-12, abs=1e-12)


async def test_set_velocity_keeps_the_spin_of_a_free_offset_body() -> None:
    start = '<keyframe><key name="start" qpos="1 2 3 0.9 0.1 0.3 0.2" qvel="4 5 6 1 2 3"/></keyframe>'
    lab = open_bench(OFFSET, start, gravity="0 0 0")
    spin = await lab.vector("get_angular_momentum", 1, mass=4)
    told = await lab("set_velocity", object_id=1, velocity_vector=[-1, 0, 2])
    assert told["velocity"] == pytest.approx([-1, 0, 2], abs=1e-12)
    assert await lab.vector("get_angular_momentum", 1, mass=4) == pytest.approx(spin, rel=1e-12)
    centre = lab.session.world.centre("object_1")
    await lab("step", duration=0.1)
    assert lab.session.world.centre("object_1") - centre == pytest.approx([-0.1, 0, 0.2], abs=1e-6)


async def test_set_velocity_of_a_child_leaves_its_parent_alone() -> None:
    lab = open_bench(DOUBLE, flags='<flag contact="disable"/>')
    await lab("set_velocity", object_id=2, velocity_vector=[1, 0, 1])
    assert await lab.velocity(1) == pytest.approx([0, 0, 0], abs=1e-12)


async def test_a_body_whose_joints_cannot_move_its_centre_is_refused_a_velocity() -> None:
    lab = open_bench('<body name="object_1"><joint type="hinge" axis="0 1 0"/><geom size="0.1" mass="1"/></body>')
    assert "centre of mass" in await lab.refused("set_velocity", object_id=1, velocity_vector=[1, 0, 0])


async def test_a_static_body_reads_as_at_rest() -> None:
    lab = open_bench('<body name="object_1" pos="0 0 2"><geom type="box" size="0.1 0.2 0.3" mass="2"/></body>')
    await lab("step", duration=0.1)
    for tool, more in (("get_velocity", {}), ("get_acceleration", {}), ("get_momentum", {"mass": 1})):
        assert await lab.vector(tool, 1, **more) == pytest.approx([0, 0, 0], abs=0)
    assert await lab.number("get_rotational_energy", 1, mass=2) == 0
    assert await lab.number("get_potential_energy", 1, mass=2) == pytest.approx(4 * G, rel=1e-15)
    assert "no movable object" in await lab.refused("get_center_of_mass")


async def test_momentum_and_centre_of_mass_of_several_bodies_add_up() -> None:
    lab = open_bench(
        ball_mjcf(1, "0 0 0", mass=1) + ball_mjcf(2, "3 0 0", mass=2) + ball_mjcf(3, "0 6 3", mass=3, joint=""),
        gravity="0 0 0",
    )
    await lab("set_velocity", object_id=1, velocity_vector=[3, 0, 0])
    seen = await lab("get_center_of_mass")
    assert (seen["included"], seen["excluded"]) == (["object_1", "object_2"], [])
    assert list(seen["center_of_mass"].values()) == pytest.approx([2, 0, 0], rel=1e-15)
    await lab("step", duration=0.5)
    assert (await lab("get_center_of_mass"))["center_of_mass"]["x"] == pytest.approx(2.5, rel=EXACT)
