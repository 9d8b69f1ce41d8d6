"""Tests of resolution and noise: they are applied once, to the state that is read, before anything is derived."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from physment_mcp.scene import Scene, load_scene
from physment_mcp.session import Session
from physment_mcp.world import Fineness, Readout, World
from scenes import Instruments, Permissions, PublicObject, list_packs, read_public
from tests.builders.bench import Bench, public_pack

ALL = Permissions(
    geom_type=True, geom_size=True, geom_radius=True, body_pos=True, body_quat=True, body_mass=True, angle=True,
    spin=True,
)  # fmt: skip
NOISY_SCENES = [
    public.scene_id
    for public in map(read_public, list_packs())
    if public.instruments is not None and public.instruments.noise is not None
]
HEAD = '<option timestep="0.005" integrator="RK4" gravity="0 0 -9.81"/>'
BALL = '<body name="object_1" pos="0.00123456 0 5"><freejoint/><geom size="0.1"/></body>'
WHEEL = """
<body name="object_1" pos="0 0 1"><joint name="axle" type="hinge" axis="0 1 0"/>
  <geom type="cylinder" size="0.1 0.02" euler="90 0 0" mass="2" contype="0" conaffinity="0"/></body>"""


def bench(body: str, permissions: Permissions = ALL, **instruments: Any) -> Bench:
    thing = PublicObject(object_id="object_1", name="thing", permissions=permissions)
    public = public_pack((thing,)).model_copy(update={"instruments": Instruments.model_validate(instruments)})
    return Bench(Session(Scene(public, f"<mujoco>{HEAD}<worldbody>{body}</worldbody></mujoco>")))


def is_multiple(value: float, unit: float) -> bool:
    return math.isclose(value / unit, round(value / unit), abs_tol=1e-6)


@given(st.floats(-100, 100), st.sampled_from([1e-4, 1e-3, 0.25]))
def test_a_reading_is_the_nearest_multiple_of_the_resolution(true: float, resolution: float) -> None:
    read = float(Readout({"position": Fineness(resolution)}).rounded("position", np.array([true]))[0])
    assert abs(read - true) <= resolution / 2 * (1 + 1e-9)
    assert is_multiple(read, resolution)


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda parts: np.linalg.norm(parts) > 0.1))
def test_a_quaternion_is_read_as_a_rotation_near_the_true_one(parts: list[float]) -> None:
    true = np.array(parts) / np.linalg.norm(parts)
    read = Readout({"angle": Fineness(0.01)}).read_quaternion(true, np.zeros(3))
    assert np.linalg.norm(read) == pytest.approx(1)
    assert 2 * math.acos(min(1.0, abs(float(true @ read)))) < 0.01 * math.sqrt(3) / 2 * (1 + 1e-6) + 1e-6


async def test_every_kind_of_position_is_rounded() -> None:
    lab = bench(BALL, position=0.001)
    assert list(await lab.position(1)) == [0.001, 0.0, 5.0]
    assert (await lab("get_center_of_mass"))["center_of_mass"]["x"] == 0.001
    await lab("step", duration=0.1)
    energy = await lab.number("get_potential_energy", 1, mass=1e6, gravity=1)
    assert is_multiple(energy / 1e6, 0.001)
    assert is_multiple(await lab.number("get_displacement", 1), 0.001)
    assert lab.session.describe(lab.session.find("object_1"))["position"] == [0.001, 0.0, 4.951]


async def test_what_is_derived_from_a_velocity_is_as_fine_as_the_velocity() -> None:
    lab = bench(BALL, velocity=0.01)
    await lab("step", duration=0.123)
    speed = (await lab.velocity(1))[2]
    assert is_multiple(speed, 0.01)
    assert await lab.number("get_kinetic_energy", 1, mass=1e6) == pytest.approx(0.5e6 * speed**2)
    assert (await lab("get_momentum", object_id=1, mass=1e6))["momentum"]["z"] == pytest.approx(1e6 * speed)
    # Over one time step the velocity changes by 0.049 m/s, which is read as 0.05 or 0.04.
    assert is_multiple((await lab("get_acceleration", object_id=1))["z"], 2.0)
    assert is_multiple((await lab("set_velocity", object_id=1, velocity_vector=[0.0149, 0, 0]))["velocity"][0], 0.01)


async def test_angle_and_angular_velocity_of_a_hinge_are_told_and_rounded() -> None:
    lab = bench(WHEEL, angle=0.001, spin=0.001)
    await lab("apply_torque", object_id=1, torque_vector=[0, 1, 0])
    await lab("step", duration=2)
    angle = (await lab("get_position", object_id=1))["angle"]
    spin = (await lab("get_velocity", object_id=1))["angular_velocity"]
    inertia = 0.5 * 2 * 0.1**2
    assert angle == pytest.approx(0.5 / inertia * 2**2, abs=0.0006)  # many turns
    assert spin == pytest.approx(2 / inertia, abs=0.0006)
    assert is_multiple(angle, 0.001)
    assert is_multiple(spin, 0.001)
    energy = await lab.number("get_rotational_energy", 1, mass=2e5)
    assert energy == pytest.approx(0.5e5 * inertia * round(2 / inertia, 3) ** 2, rel=1e-9)


async def test_they_are_null_where_they_are_not_shown_and_without_a_hinge() -> None:
    for lab in (bench(WHEEL, ALL.model_copy(update={"angle": False, "spin": None})), bench(BALL)):
        assert (await lab("get_position", object_id=1))["angle"] is None
        assert (await lab("get_velocity", object_id=1))["angular_velocity"] is None


async def test_a_withheld_spin_withholds_the_energy_and_the_momentum_of_the_spin() -> None:
    lab = bench(WHEEL, ALL.model_copy(update={"spin": False}))
    for tool in ("get_rotational_energy", "get_angular_momentum"):
        assert "the spin of object_1 is withheld" in await lab.refused(tool, object_id=1, mass=1)
    await lab("get_velocity", object_id=1)


async def test_noise_repeats_at_one_moment_and_averages_away_over_time() -> None:
    lab = bench(BALL.replace("<freejoint/>", ""), position=0.001, noise={"position": 0.02})
    readings: list[float] = []
    for _ in range(400):
        first, again = await lab.position(1), await lab.position(1)
        assert list(first) == list(again)
        readings.append(first[1])
        await lab("step", duration=0.005)
    assert np.std(readings) == pytest.approx(0.02, rel=0.15)
    assert abs(np.mean(readings)) < 4 * 0.02 / math.sqrt(400)
    assert abs(np.corrcoef(readings[:-1], readings[1:])[0, 1]) < 0.2


async def test_noise_is_the_same_in_every_episode_of_a_scene_and_independent_between_quantities() -> None:
    first, second = (bench(BALL, noise={"position": 0.02, "velocity": 0.02}) for _ in range(2))
    for lab in (first, second):
        await lab("step", duration=0.1)
    assert list(await first.position(1)) == list(await second.position(1))
    errors = Readout({"position": Fineness(0, 1), "velocity": Fineness(0, 1)}, "7")
    assert not np.allclose(errors.noise("position", "a", 1, 3), errors.noise("velocity", "a", 1, 3))
    assert not np.allclose(errors.noise("position", "a", 1, 3), errors.noise("position", "b", 1, 3))


NOISY = {"position": 0.02, "velocity": 0.03, "angle": 0.01, "spin": 0.05}
PENDULUM = """
<body name="frame" pos="0 0 2" euler="0 20 35"><body name="object_1" euler="30 0 10">
  <joint name="axle" type="hinge" axis="0.6 0 0.8" ref="0"/>
  <geom type="box" size="0.1 0.2 0.3" pos="0.1 0 -0.3" mass="2" contype="0" conaffinity="0"/></body></body>"""


def rotation(quaternion: Any) -> Rotation:
    return Rotation.from_quat(quaternion, scalar_first=True)


async def test_orientation_and_joint_angle_of_one_body_have_the_same_noise() -> None:
    """With independent noise, the mean of both readings would be more precise than each of them."""
    lab = bench(PENDULUM, noise={"angle": 0.001})
    world = lab.session.world
    errors: list[float] = []
    for _ in range(60):
        await lab("step", duration=0.05)
        read = await lab("get_position", object_id=1)
        now = world._now()
        axis = now.xaxis[world._model.joint("axle").id]
        off = rotation(read["orientation"]) * rotation(now.xquat[world._id("object_1")]).inv()
        errors.append(read["angle"] - now.qpos[0])
        assert float(off.as_rotvec() @ axis) == pytest.approx(errors[-1], abs=1e-9)
    assert np.std(errors) == pytest.approx(0.001, rel=0.3)


async def test_spin_angular_momentum_and_rotational_energy_of_one_body_have_the_same_noise() -> None:
    lab = bench(WHEEL, noise={"spin": 0.05})
    await lab("apply_torque", object_id=1, torque_vector=[0, 1, 0])
    inertia = 0.5 * 2 * 0.1**2  # about the axle
    for _ in range(20):
        await lab("step", duration=0.05)
        spin = (await lab("get_velocity", object_id=1))["angular_velocity"]
        moment = (await lab("get_angular_momentum", object_id=1, mass=2))["angular_momentum"]["y"]
        assert moment == pytest.approx(inertia * spin, rel=1e-9)


async def test_what_is_derived_from_one_noisy_state_agrees() -> None:
    lab = bench(BALL, noise=NOISY)
    start = await lab.position(1)
    await lab("set_velocity", object_id=1, velocity_vector=[1, 2, 3])
    for _ in range(10):
        await lab("step", duration=0.05)
        place, speed = np.array(await lab.position(1)), np.array(await lab.velocity(1))
        assert await lab.number("get_displacement", 1) == pytest.approx(np.linalg.norm(place - start))
        centre = (await lab("get_center_of_mass"))["center_of_mass"]
        assert [centre[axis] for axis in "xyz"] == pytest.approx(list(place))
        assert await lab.number("get_potential_energy", 1, mass=2) == pytest.approx(2 * 9.81 * place[2])
        assert await lab.number("get_kinetic_energy", 1, mass=2) == pytest.approx(speed @ speed)
        before = speed
        await lab("step", duration=0.005)
        change = np.array(await lab.velocity(1)) - before
        force = await lab("compute_force", object_id=1, mass=1)
        assert [force[axis] for axis in "xyz"] == pytest.approx(list(change / 0.005))


async def test_a_contact_is_read_the_same_whichever_object_is_named_first() -> None:
    touching = [await contact_of(*names, position=0.001, noise=NOISY) for names in ((1, 2), (2, 1))]
    assert touching[0]["contact_point"] == touching[1]["contact_point"]
    assert touching[0]["approach_speed"] == touching[1]["approach_speed"]
    assert touching[0]["normal"] == [-part for part in touching[1]["normal"]]


async def test_a_contact_tells_no_more_of_a_body_than_the_readings_of_that_body() -> None:
    """The noise of a contact contains that of both bodies, so averaging with their readings gains nothing."""
    readout = Readout({"position": Fineness(0, 0.02)}, "7")
    world = World(f"<mujoco>{HEAD}<worldbody>{TOUCHING}</worldbody></mujoco>", readout=readout)
    exact = World(f"<mujoco>{HEAD}<worldbody>{TOUCHING}</worldbody></mujoco>")
    rows: list[list[float]] = []
    for each in (world, exact):
        each.push("object_1", np.array([20.0, 0, 0]))
        each.step(200)
    for _ in range(400):
        for each in (world, exact):
            each.step(1)
        read, true = world.contact("object_1", "object_2"), exact.contact("object_1", "object_2")
        assert read is not None
        assert true is not None
        errors = [world.pose(body).position[0] - exact.pose(body).position[0] for body in ("object_1", "object_2")]
        rows.append([read.point[0] - true.point[0], *errors])
    covariance = np.cov(np.array(rows).T) / 0.02**2
    assert covariance[0] == pytest.approx([3, 1, 1], abs=0.5)
    assert covariance[1:, 1:] == pytest.approx(np.eye(2), abs=0.3)


TOUCHING = """
<body name="object_1" pos="0 0 1" gravcomp="1"><joint type="slide" axis="1 0 0"/><geom size="0.1" mass="1"/></body>
<body name="object_2" pos="0.1999 0 1"><geom size="0.1" mass="1"/></body>"""


async def contact_of(first: int, second: int, **instruments: Any) -> dict[str, Any]:
    """Return the reading of `detect_collision` for two balls that touch."""
    things = tuple(PublicObject(object_id=f"object_{n}", name="thing", permissions=ALL) for n in (1, 2))
    public = public_pack(things).model_copy(update={"instruments": Instruments.model_validate(instruments)})
    lab = Bench(Session(Scene(public, f"<mujoco>{HEAD}<worldbody>{TOUCHING}</worldbody></mujoco>")))
    await lab("set_velocity", object_id=1, velocity_vector=[0.5, 0, 0])
    return await lab("detect_collision", obj1_id=first, obj2_id=second, elastic_response=False)


@pytest.mark.parametrize("scene", NOISY_SCENES)
async def test_all_readings_of_a_noisy_scene_derive_from_one_state(scene: int) -> None:
    lab = Bench(Session(load_scene(scene, 3)))
    session = lab.session
    for item in session.known():
        object_id = item.object_id
        for _ in range(5):
            await lab("step", duration=0.1)
            place = np.array((await lab("get_position", object_id=object_id))["position"])
            assert await lab.number("get_displacement", object_id) == pytest.approx(
                float(np.linalg.norm(place - item.start)), abs=1e-9
            )
            if session.may_read(item, "velocity") and "get_kinetic_energy" not in session.scene.public.disabled_tools:
                speed = np.array((await lab("get_velocity", object_id=object_id))["velocity"])
                energy = await lab.number("get_kinetic_energy", object_id, mass=2)
                assert energy == pytest.approx(float(speed @ speed), abs=1e-9)
            turn, twist = session.world.turn(item.body), session.world.twist(item.body)
            if turn is not None and session.may_read(item, "spin"):
                axis = session.world._now().xaxis[session.world._model.body(item.body).jntadr[0]]
                resolution = session.scene.public.instruments.spin  # pyright: ignore[reportOptionalMemberAccess]
                assert float(twist.angular @ axis) == pytest.approx(turn.spin, abs=resolution * 2)


async def test_an_object_is_put_to_places_no_more_finely_than_positions_are_read() -> None:
    wall = '<geom type="box" pos="1.0004 0 5" size="0.1 1 1"/>'
    lab = bench(BALL + wall, position=0.01)
    moved = await lab("move_object", object_id=1, x=0.0149, y=0, z=5)
    assert moved["position"] == [0.01, 0.0, 5.0]
    assert lab.session.world._data.qpos[0] == pytest.approx(0.01, abs=1e-15)  # pyright: ignore[reportPrivateUsage]
    # The wall is at 0.8004: no refusal reveals its position between two grid points.
    for x in np.linspace(0.7951, 0.8049, 9):
        assert (await lab("move_object", object_id=1, x=float(x), y=0, z=5))["position"][0] == 0.8


def test_the_true_state_is_not_rounded() -> None:
    coarse = World(f"<mujoco>{HEAD}<worldbody>{BALL}</worldbody></mujoco>", readout=Readout({"position": Fineness(1)}))
    exact = World(f"<mujoco>{HEAD}<worldbody>{BALL}</worldbody></mujoco>")
    for world in (coarse, exact):
        world.pose("object_1")
        world.step(100)
    assert (coarse.save().state == exact.save().state).all()


def test_the_clock_is_a_whole_number_of_time_steps() -> None:
    world = World(f"<mujoco>{HEAD}<worldbody>{BALL}</worldbody></mujoco>")
    for step in range(1, 300):
        world.step(1)
        assert world.time == round(step * 0.005, 12)
