"""Tests of time, limits and roll-back; readings change nothing; the same calls give the same episode."""

import math
import threading
from collections.abc import Generator
from pathlib import Path
from typing import Any

import anyio
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from physment_mcp.errors import RefusedCall, SceneError
from physment_mcp.session import MAX_SIMULATED_S
from physment_mcp.world import World
from tests.builders.bench import Bench, ball_mjcf, open_bench

# A spring far too stiff for the time step: with k Δt²/m = 2500 every explicit integrator is unstable.
BOMB = """
<body name="object_1" pos="0 0 1"><joint type="slide" axis="0 0 1" stiffness="1e5" springref="0.1"/>
  <geom size="0.01" mass="1e-3"/>
</body>
"""


async def test_a_step_is_rounded_to_whole_time_steps() -> None:
    lab = open_bench(ball_mjcf(1, "0 0 5"))
    for duration, steps in ((0.005, 1), (0.0124, 2), (0.0126, 3), (1e-9, 1), (5e-324, 1), (0.3, 60), (1 / 3, 67)):
        before = lab.session.world.time
        told = await lab("step", duration=duration)
        assert told["steps"] == steps
        assert told["sim_time"] - before == pytest.approx(steps * 0.005, abs=1e-12)
        assert told["results"] is None


async def test_simulated_time_is_bounded_by_an_hour() -> None:
    lab = open_bench(ball_mjcf(1, "0 0 5"), dt=0.02, gravity="0 0 0")
    for _ in range(59):
        await lab("step", duration=60)
    await lab("step", duration=59)
    assert "1 s of laboratory time are left" in await lab.refused("step", duration=1.1)
    await lab("step", duration=1)
    assert lab.session.state.simulated_s == pytest.approx(MAX_SIMULATED_S)
    assert "0 s of laboratory time are left" in await lab.refused("step", duration=0.001)
    await lab("get_position", object_id=1)


async def test_progress_does_not_change_the_physics() -> None:
    link = '<joint type="hinge" axis="0 1 0"/><geom size="0.1" pos="0 0 -0.5"/>'
    chaotic = (
        f'<body name="object_1" pos="0 0 3" euler="0 170 0">{link}'
        f'<body name="object_2" pos="0 0 -0.5">{link}</body></body>'
    )
    once, often = open_bench(chaotic), open_bench(chaotic)
    seen: list[tuple[float, float]] = []

    async def note(done: float, total: float) -> None:
        seen.append((done, total))

    await once("step", report=note, duration=20)
    for _ in range(400):
        await often("step", duration=0.05)
    assert seen
    assert all(0 < done < total == 20 for done, total in seen)
    assert once.session.world.save().state.tobytes() == often.session.world.save().state.tobytes()


async def test_a_cancelled_step_changes_nothing() -> None:
    lab = open_bench(ball_mjcf(1, "0 0 0.5") + '<body name="object_2"><geom type="plane" size="9 9 1"/></body>')
    await lab("apply_force", object_id=1, force_vector=[1, 0, 0])
    await lab("step", duration=0.5)
    before, acceleration = lab.fingerprint(), await lab.vector("get_acceleration", 1)
    with anyio.CancelScope() as scope:

        async def stop(_done: float, _total: float) -> None:
            scope.cancel()

        await lab("step", report=stop, duration=60)
    assert scope.cancelled_caught
    assert lab.fingerprint() == before
    assert np.array_equal(await lab.vector("get_acceleration", 1), acceleration)
    twin = open_bench(ball_mjcf(1, "0 0 0.5") + '<body name="object_2"><geom type="plane" size="9 9 1"/></body>')
    await twin("apply_force", object_id=1, force_vector=[1, 0, 0])
    await twin("step", duration=0.5)
    for side in (lab, twin):
        await side("step", duration=1)
    assert lab.session.world.save().state.tobytes() == twin.session.world.save().state.tobytes()


async def test_only_pieces_that_take_long_run_in_a_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    lab = open_bench(ball_mjcf(1, "0 0 5"))
    world, ran_in = lab.session.world, list[int]()
    step = world.step

    def watched(steps: int) -> None:
        ran_in.append(threading.get_ident())
        step(steps)

    monkeypatch.setattr(world, "step", watched)
    for pace_s, inline in ((None, True), (1e-6, True), (1.0, False)):
        world._pace_s = pace_s
        await lab("step", duration=0.04)
        assert (ran_in[-1] == threading.get_ident()) is inline


async def test_a_step_cancelled_in_its_last_piece_changes_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    lab = open_bench(ball_mjcf(1, "0 0 5"))
    before, step = lab.fingerprint(), lab.session.world.step
    with anyio.CancelScope() as scope:

        def cancelled_meanwhile(steps: int) -> None:
            scope.cancel()
            step(steps)

        monkeypatch.setattr(lab.session.world, "step", cancelled_meanwhile)
        await lab("step", duration=0.1)
    assert scope.cancelled_caught
    assert lab.fingerprint() == before


@pytest.fixture
def no_engine_log() -> Generator[None]:
    """Checks afterwards that the engine has not written its log of warnings into the working directory."""
    yield
    assert not Path("MUJOCO_LOG.TXT").exists()


@pytest.mark.usefixtures("no_engine_log")
@pytest.mark.parametrize("integrator", ["RK4", "Euler", "implicitfast"])
async def test_a_blow_up_is_rolled_back_twice_in_a_row_and_writes_no_log(integrator: str) -> None:
    lab = open_bench(BOMB, integrator=integrator, flags='<flag eulerdamp="disable"/>')
    for _ in range(2):
        assert "rolled back" in await lab.refused("step", duration=10)
        assert await lab.position(1) == pytest.approx([0, 0, 1])
    assert "no velocity difference" in await lab.refused("get_acceleration", object_id=1)
    await lab("delete_objects", object_id=1)
    await lab("create_objects", name="p", pos=[0, 0, 1], density=100, rgba=[1, 1, 1, 1])
    await lab("step", duration=0.5)
    assert await lab.velocity("p") == pytest.approx([0, 0, -9.81 / 2], rel=1e-9)


async def test_a_result_that_is_not_finite_is_refused() -> None:
    lab = open_bench(ball_mjcf(1, "0 0 5"))
    lab.session.world.set_velocity("object_1", np.array([1e200, 0, 0]))  # its square is not finite any more
    with np.errstate(over="ignore"):
        assert "rolled back" in await lab.refused("get_kinetic_energy", object_id=1, mass=1)


async def test_a_result_that_is_not_finite_is_refused_by_a_tool_that_may_change_something() -> None:
    lab = open_bench(ball_mjcf(1, "0 0 5") + ball_mjcf(2, "0.19 0 5"))
    for name, speed in (("object_1", 1.5e308), ("object_2", -1.5e308)):
        lab.session.world.set_velocity(name, np.array([speed, 0, 0]))
    with np.errstate(over="ignore", invalid="ignore"):
        told = await lab.refused("detect_collision", obj1_id=1, obj2_id=2, elastic_response=False)
    assert told == "detect_collision: the result is not a finite number, so the call was rolled back"


async def test_limits_of_force_and_speed_do_not_break_the_world() -> None:
    lab = open_bench(
        ball_mjcf(1, "0 0 5", mass=1e-3) + '<body name="object_2"><geom type="plane" size="9 9 1"/></body>'
    )
    await lab("set_velocity", object_id=1, velocity_vector=[0, 0, -1e6])
    await lab("apply_force", object_id=1, force_vector=[1e6, -1e6, 1e6])
    await lab("apply_torque", object_id=1, torque_vector=[1e6, 1e6, 1e6])
    for told in await play(lab, [("step", {"duration": 1})]):
        assert "rolled back" in told or told["sim_time"] == pytest.approx(1)
    readings = [*await lab.position(1), *await lab.velocity(1)]
    assert all(math.isfinite(value) for value in readings)


PLAYGROUND = """
<body name="object_1"><geom type="plane" size="20 20 1"/></body>
<body name="object_2" pos="0 0 0.3"><joint type="free"/><geom type="box" size="0.1 0.15 0.2" mass="2"/></body>
<body name="object_3" pos="1 0 0.1"><joint type="free"/><geom size="0.1" mass="1"/></body>
<body name="object_4" pos="2 0 1"><joint type="hinge" axis="0 1 0"/><geom size="0.1" pos="0.5 0 0"/>
  <body name="object_5" pos="0.5 0 0"><joint type="hinge" axis="0 1 0"/><geom size="0.1" pos="0.4 0 0"/></body>
</body>
<body name="object_6" pos="0 2 0.1"><joint type="free"/><geom size="0.1" mass="3"/></body>
"""
READS = [
    ("get_position", {}), ("get_velocity", {}), ("get_acceleration", {}), ("get_torque", {}), ("get_parameters", {}),
    ("get_displacement", {}), ("compute_force", {"mass": 1}), ("get_kinetic_energy", {"mass": 1}),
    ("get_potential_energy", {"mass": 1}), ("get_rotational_energy", {"mass": 1}), ("get_momentum", {"mass": 1}),
    ("get_angular_momentum", {"mass": 1}),
]  # fmt: skip
movable = st.integers(2, 6)
small = st.floats(-3, 3, allow_subnormal=False)
vector = st.tuples(small, small, small).map(list)
actions = st.one_of(
    st.builds(lambda d: ("step", {"duration": d}), st.sampled_from([0.005, 0.02, 0.1])),
    st.builds(lambda o, v: ("apply_force", {"object_id": o, "force_vector": v}), movable, vector),
    st.builds(lambda o, v: ("apply_torque", {"object_id": o, "torque_vector": v}), movable, vector),
    st.builds(lambda o, v: ("set_velocity", {"object_id": o, "velocity_vector": v}), movable, vector),
    st.builds(lambda o, v: ("change_position", {"object_id": o, "dx": v[0], "dy": v[1], "dz": 1}), movable, vector),
    st.builds(lambda a, b: ("detect_collision", {"obj1_id": a, "obj2_id": b}), movable, st.integers(1, 6)),
    st.builds(
        lambda a, b, j: ("attach_objects", {"object1_id": a, "object2_id": b, "joint": j}),
        movable, movable, st.sampled_from(["weld", "ball", "hinge"]),
    ),
    st.builds(
        lambda n, v: ("create_objects", {"name": n, "pos": [v[0], v[1], 1], "density": 500, "rgba": [1, 1, 1, 1]}),
        st.sampled_from("abc"), vector,
    ),
    st.builds(lambda o: ("delete_objects", {"object_id": o}), st.sampled_from(["a", "b", 3, 6, 5])),
    st.builds(lambda: ("find_objects", {})),
)  # fmt: skip
reads = st.one_of(
    st.builds(
        lambda r, o: (r[0], {"object_id": o, **r[1]}), st.sampled_from(READS), st.one_of(movable, st.sampled_from("ab"))
    ),
    st.builds(lambda: ("get_center_of_mass", {})),
    st.builds(
        lambda a, b: ("detect_collision", {"obj1_id": a, "obj2_id": b, "elastic_response": False}), movable, movable
    ),
)
slow = settings(max_examples=40, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])


async def play(lab: Bench, calls: list[tuple[str, dict[str, Any]]]) -> list[Any]:
    """Make calls; returns results and refusals, and checks that refusals change nothing."""
    told = []
    for tool, arguments in calls:
        before = lab.fingerprint()
        try:
            told.append(await lab(tool, **arguments))
        except RefusedCall as refusal:
            assert lab.fingerprint() == before
            told.append(str(refusal))
    return told


@slow
@given(st.lists(st.tuples(actions, st.lists(reads, max_size=4)), min_size=3, max_size=12))
async def test_extra_reads_leave_the_dynamics_bit_identical(script: Any) -> None:
    plain, curious = open_bench(PLAYGROUND), open_bench(PLAYGROUND)
    for action, extra in script:
        told = await play(plain, [action])
        before = curious.fingerprint()
        await play(curious, extra)
        assert curious.fingerprint() == before
        assert await play(curious, [action]) == told
        assert curious.session.world.save().state.tobytes() == plain.session.world.save().state.tobytes()


@slow
@given(st.lists(st.one_of(actions, reads), min_size=3, max_size=15))
async def test_the_same_calls_give_the_same_results(script: Any) -> None:
    first, second = open_bench(PLAYGROUND), open_bench(PLAYGROUND)
    assert await play(first, script) == await play(second, script)
    assert first.session.world.save().state.tobytes() == second.session.world.save().state.tobytes()


@slow
@given(st.lists(actions, max_size=8), st.lists(actions, min_size=1, max_size=4))
async def test_a_failure_after_any_calls_undoes_them_all(before: Any, within: Any) -> None:
    lab = open_bench(PLAYGROUND)
    await play(lab, before)
    state = lab.fingerprint()

    async def fail() -> None:
        with lab.session.all_or_nothing():
            await play(lab, within)
            lab.session.answer(1)
            raise KeyError("stop")

    with pytest.raises(KeyError, match="stop"):
        await fail()
    assert lab.fingerprint() == state
    twin = open_bench(PLAYGROUND)
    await play(twin, before)
    after = [("step", {"duration": 0.1}), *[("get_velocity", {"object_id": n}) for n in (2, 3, 4, 5, 6)]]
    assert await play(lab, after) == await play(twin, after)


@slow
@given(
    pushes=st.lists(st.tuples(st.integers(1, 4), vector, vector), min_size=1, max_size=4),
    duration=st.sampled_from([0.05, 0.2, 0.5]),
)
async def test_momentum_is_conserved_when_nothing_pushes(pushes: Any, duration: float) -> None:
    # Four balls that may hit each other, two of them attached, and no gravity: no outside force is left.
    masses = {1: 1.0, 2: 2.0, 3: 0.5, 4: 4.0}
    bodies = "".join(
        f'<body name="object_{n}" pos="{0.25 * n} {0.05 * n} 0"><joint type="free"/>'
        f'<geom size="0.1" mass="{m}"/></body>'
        for n, m in masses.items()
    )
    lab = open_bench(bodies, gravity="0 0 0")
    await lab("attach_objects", object1_id=3, object2_id=4, joint="ball")
    for number, force, velocity in pushes:
        await lab("apply_force", object_id=number, force_vector=force)
        await lab("set_velocity", object_id=number, velocity_vector=velocity)
    await lab("step", duration=0.05)
    for number in masses:
        await lab("apply_force", object_id=number, force_vector=[0, 0, 0])

    async def total() -> np.ndarray:
        return sum([await lab.vector("get_momentum", n, mass=m) for n, m in masses.items()], start=np.zeros(3))

    before = await total()
    await lab("step", duration=duration)
    # Constraint forces come in exact pairs. What remains is the rounding of forces of some 1e4 N over a hundred steps.
    assert await total() == pytest.approx(before, abs=1e-8)


async def test_half_the_time_step_gives_the_same_fall() -> None:
    lab = open_bench(ball_mjcf(1, "0 0 5"))
    finer = World(lab.session.scene.mjcf, timestep=0.0025)
    assert finer.timestep == 0.0025
    finer.step(finer.whole_steps(0.5))
    await lab("step", duration=0.5)
    assert finer.twist("object_1").linear == pytest.approx(await lab.velocity(1), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize(
    "xml", ["", "<mujoco>", "<mujoco><worldbody><body><geom size='-1'/></body></worldbody></mujoco>", "x"]
)
def test_a_model_that_does_not_compile_is_refused_in_one_sentence(xml: str) -> None:
    with pytest.raises(SceneError, match="does not compile") as error:
        World(xml)
    assert "\n" not in str(error.value)


async def test_refused_calls_are_counted_too() -> None:
    lab = open_bench(ball_mjcf(1, "0 0 5"))
    await lab("step", duration=0.1)
    await lab.refused("step", duration=-1)
    await lab.refused("no such tool")
    await lab("answer", answer=[1, "two"])
    assert lab.session.calls == 4
    await lab.refused("step", duration=1)
    assert lab.session.calls == 4
    assert lab.session.state.answer == [1, "two"]
