"""Tests of laws: forces against closed forms, when they act, when they end, and refusals."""

import gc
import json
import math
import re
import subprocess
import sys
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import mujoco
import numpy as np
import pytest
from scipy.integrate import quad

import physment_mcp.world
from physment_mcp.errors import NoDifference, SceneError, Unstable
from physment_mcp.world import World
from physment_mcp.world.laws import laws_at_start

Law = Mapping[str, Any]
NONE = ["0", "0", "0"]
PUCK = (
    '<body name="puck" pos="{0} {1} 0"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>'
    '<geom size="0.05" mass="2"/></body>'
)
BALL = '<body name="{0}" pos="{1} 0 0"><freejoint/><geom size="0.05" mass="{2}" contype="0"/></body>'
CART = '<body name="cart"><joint type="slide" axis="1 0 0"/><geom size="0.05" mass="2"/></body>'
ARM = (
    '<body name="arm"><joint name="pin" type="hinge" axis="0 1 0"/><inertial pos="0 0 -1" mass="1"'
    ' diaginertia="0.5 0.5 0.5"/></body>'
)


def model(bodies: str, *laws: Law, dt: float = 0.01, qpos: str = "", qvel: str = "", rest: str = "") -> str:
    """MJCF without gravity, with its laws and a start state."""
    text = f'<custom><text name="laws" data={quoteattr(json.dumps(laws))}/></custom>' if laws else ""
    start = f'qpos="{qpos}"' * bool(qpos) + f' qvel="{qvel}"' * bool(qvel)
    return (
        f'<mujoco><option integrator="RK4" gravity="0 0 0" timestep="{dt}"/>{rest}{text}'
        f'<worldbody>{bodies}</worldbody><keyframe><key name="start" {start}/></keyframe></mujoco>'
    )


def run(world: World, duration: float) -> World:
    world.step(world.whole_steps(duration))
    return world


def state(world: World) -> bytes:
    return world.save().state.tobytes()


# Closed forms


def test_drag_in_proportion_to_the_velocity_makes_it_decay_exponentially() -> None:
    drag = {"on": "cart", "constants": {"b": 3.0}, "force": ["-b*vx", "0", "0"]}
    world = run(World(model(CART, drag, qvel="1.5")), 1.0)
    assert world.twist("cart").linear[0] == pytest.approx(1.5 * math.exp(-3.0 / 2), rel=1e-9)


def test_a_body_without_mass_is_where_its_frame_is() -> None:
    """A law reads the frame of a body without mass; the centre of mass that MuJoCo gives is twice as far away."""
    far = {"on": "cart", "with": {"mark": "mark"}, "force": ["mark_x", "mark_y", "0"]}
    world = run(World(model(CART + '<body name="mark" pos="0.2 0.7 0"/>', far)), 1.0)
    assert world.twist("cart").linear[0] == pytest.approx(0.2 / 2, rel=1e-9)


def test_an_inverse_square_attraction_makes_keplers_ellipse() -> None:
    """Released with v² = 0.6 GM/r, so the semi-major axis a is r/1.4 and the period 2π sqrt(a³/GM)."""
    pull = {
        "on": "puck",
        "constants": {"k": 2.0},  # on a mass of 2 kg: GM = 1 m³/s²
        "let": {"r": "hypot(x, y)"},
        "force": ["-k*x/r**3", "-k*y/r**3", "0"],
    }
    world = World(model(PUCK.format(1, 0), pull, dt=0.001, qpos="0 0", qvel=f"0 {math.sqrt(0.6)}"))
    half_axis = 1 / 1.4
    period = 2 * math.pi * half_axis**1.5

    def energy() -> float:
        return 0.5 * float(np.sum(world.twist("puck").linear ** 2)) - 1 / float(np.linalg.norm(world.centre("puck")))

    world.step(round(period / 2 / 0.001))
    assert energy() == pytest.approx(-1 / (2 * half_axis), rel=1e-8)
    assert world.centre("puck")[0] == pytest.approx(-(2 * half_axis - 1), rel=1e-5)
    world.step(round(period / 0.001) - round(period / 2 / 0.001))
    # The period is not a whole number of steps: the body is up to half a step, at the speed sqrt(0.6), from the start.
    assert world.centre("puck")[:2] == pytest.approx([1, 0], abs=0.0005)
    assert energy() == pytest.approx(-1 / (2 * half_axis), rel=1e-8)


def test_a_spring_of_an_odd_power_swings_with_the_period_of_the_energy_integral() -> None:
    spring = {"on": "cart", "constants": {"k": 5.0}, "force": ["-k*sign(x)*abs(x)**2.5", "0", "0"]}
    world = World(model(CART, spring, dt=0.001, qpos="0.8"))
    # m v²/2 = k (A^3.5 − x^3.5)/3.5; x = A sin(u) removes the root's singularity at the turning point.
    factor = 2 * 5.0 / (2 * 3.5) * 0.8**1.5
    quarter = quad(lambda u: math.cos(u) / math.sqrt(factor * (1 - math.sin(u) ** 3.5)), 0, math.pi / 2)[0]
    before, after = 0.0, 0.0
    while world.centre("cart")[0] > 0:
        before, after = after, world.centre("cart")[0]
        world.step(1)
    crossing = world.time - 0.001 * world.centre("cart")[0] / (world.centre("cart")[0] - after)
    assert before > after
    assert crossing == pytest.approx(quarter, rel=1e-6)


def test_a_force_that_depends_on_time_is_integrated_over_time() -> None:
    push = {"on": "cart", "force": ["6*cos(2*pi*t) if t < 0.25 else 0", "0", "0"]}
    world = run(World(model(CART, push, dt=0.0025)), 1.0)
    assert world.twist("cart").linear[0] == pytest.approx(6 / (2 * math.pi) / 2, rel=1e-4)


def test_a_cubic_torque_on_a_hinge_swings_with_the_period_of_the_energy_integral() -> None:
    law = {"on": "arm", "constants": {"k": 4.0}, "torque": ["0", "-k*angle**3", "0"]}
    world = World(model(ARM, law, dt=0.001, qpos="0.5"))
    # I = 0.5 + 1·1² about the pin; T = 4 K(1/√2) / (A √(k/I)) for the quartic potential.
    period = 4 * 1.8540746773013719 / (0.5 * math.sqrt(4.0 / 1.5))
    world.step(round(period / 0.001))
    late = period - world.time
    assert world.save().data.qpos[0] == pytest.approx(0.5, abs=1e-6)
    assert world.save().data.qvel[0] == pytest.approx(4.0 * 0.5**3 / 1.5 * late, abs=1e-5)


def test_the_spin_of_a_hinge_and_the_spin_about_its_axis_give_the_same_damping() -> None:
    decays = [
        run(World(model(ARM, {"on": "arm", "torque": ["0", f"-3*{name}", "0"]}, qvel="2")), 1.0).twist("arm").angular
        for name in ("spin", "wy")
    ]
    assert decays[0][1] == pytest.approx(2 * math.exp(-3.0 / 1.5), rel=1e-8)
    assert decays[1] == pytest.approx(decays[0], rel=1e-12)


def test_a_force_acts_at_the_centre_of_mass_and_not_at_the_origin_of_the_body() -> None:
    bodies = '<body name="rod"><freejoint/><geom type="box" size="1 .1 .1" pos="1 0 0" mass="2"/></body>'
    law = {"on": "rod", "constants": {"k": 2.0}, "force": ["0", "k*(x - vx)", "0"]}
    world = run(World(model(bodies, law)), 0.5)
    assert world.twist("rod").angular == pytest.approx([0, 0, 0], abs=1e-12)
    assert world.twist("rod").linear[1] == pytest.approx(0.5, rel=1e-9)


def test_a_reaction_conserves_momentum_and_without_it_momentum_grows() -> None:
    pull = {
        "on": "a",
        "with": {"other": "b"},
        "let": {"d": "x - other_x"},
        "force": ["-4*d**3 - 0.3*(vx - other_vx)", "0.2*other_vx", "0"],
    }
    bodies = BALL.format("a", 0.5, 1) + BALL.format("b", -0.5, 3)

    def momentum(law: Law) -> np.ndarray:
        world = run(World(model(bodies, law)), 1.0)
        return world.twist("a").linear + 3 * world.twist("b").linear

    assert momentum({**pull, "reaction": "other"}) == pytest.approx([0, 0, 0], abs=1e-12)
    assert np.abs(momentum(pull)).max() > 0.1


def test_several_laws_add_to_each_other_and_to_the_joints_own_forces() -> None:
    damped = CART.replace("<joint ", '<joint damping="1" ')
    laws = [{"on": "cart", "force": ["-vx", "0", "0"]}, {"on": "cart", "force": ["-2*vx", "0", "0"]}]
    world = run(World(model(damped, *laws, qvel="1")), 1.0)
    assert world.twist("cart").linear[0] == pytest.approx(math.exp(-2), rel=1e-8)


def test_the_error_of_runge_kutta_falls_as_the_fourth_power_of_the_time_step() -> None:
    """The order is four only if the force is evaluated in every stage, at the stage's time."""
    law = {"on": "cart", "force": ["-8*x + 3*sin(2*t)", "0", "0"]}
    errors: list[float] = []
    for dt in (0.02, 0.01, 0.005):
        world = run(World(model(CART, law, dt=dt)), 2.0)
        # m = 2: x'' + 4x = 1.5 sin 2t from rest at 0 → x = 1.5 (sin 2t − 2t cos 2t)/8, v = 0.75 t sin 2t
        place = world.centre("cart")[0] - 1.5 * (math.sin(4) - 4 * math.cos(4)) / 8
        speed = world.twist("cart").linear[0] - 0.75 * 2 * math.sin(4)
        errors.append(math.hypot(place, speed / 2))
    assert [coarse / fine for coarse, fine in pairwise(errors)] == pytest.approx([16, 16], rel=0.15)


# Readings, roll-back, edits

SPRING = {"on": "a", "constants": {"k": 7.0}, "force": ["-k*x", "-k*y", "-k*z"]}
PAIR = BALL.format("a", 0.5, 1) + BALL.format("b", -0.5, 3)
BOND = {"on": "a", "with": {"other": "b"}, "force": ["-5*(x - other_x)", "0", "0"], "reaction": "other"}


def test_readings_change_nothing_and_see_the_law() -> None:
    quiet, read = World(model(PAIR, SPRING)), World(model(PAIR, SPRING))
    for _ in range(20):
        quiet.step(3)
        read.step(3)
        read.pose("a")
        read.twist("b")
        acceleration = read.acceleration("a")
        assert acceleration[0] == pytest.approx(-7 * read.centre("a")[0], abs=0.1)
    assert state(read) == state(quiet)


def test_a_roll_back_over_steps_and_edits_repeats_the_run_bit_for_bit() -> None:
    world = run(World(model(PAIR, BOND, SPRING)), 0.3)
    saved = world.save()
    expected = state(run(world, 0.5))
    world.restore(saved)
    assert state(run(world, 0.5)) == expected
    world.restore(saved)
    world.remove("b")
    world.add_ball("c", np.array([3.0, 0, 0]), 100.0, 0.1, np.ones(4), {})
    run(world, 0.5)
    gc.collect()
    world.restore(saved)
    assert state(run(world, 0.5)) == expected


def test_the_acceleration_over_an_edit_is_read_with_the_law_of_the_model_before() -> None:
    drag = {"on": "a", "force": ["-2*vx", "0", "0"]}
    world = World(model(PAIR, drag, qvel="1 0 0 0 0 0 0 0 0 0 0 0", qpos="0 0 0 1 0 0 0 2 0 0 1 0 0 0"))
    world.step(10)
    before = world.acceleration("a")
    world.remove("b")
    assert world.acceleration("a") == pytest.approx(before, rel=1e-12)
    assert before[0] == pytest.approx(-2 * world.twist("a").linear[0], rel=0.02)


def test_a_law_goes_on_after_an_object_is_created_and_after_two_are_joined() -> None:
    plain, edited = World(model(PAIR, SPRING)), World(model(PAIR, SPRING))
    run(plain, 0.2)
    run(edited, 0.2)
    edited.add_ball("c", np.array([3.0, 0, 0]), 100.0, 0.1, np.ones(4), {})
    edited.add_ball("d", np.array([4.0, 0, 0]), 100.0, 0.1, np.ones(4), {})
    edited.join("c", "d", "weld")
    assert run(edited, 0.5).centre("a") == pytest.approx(run(plain, 0.5).centre("a"), rel=1e-12)


@pytest.mark.parametrize("gone", ["a", "b"])
def test_a_law_ceases_when_a_body_that_it_names_is_deleted_and_the_others_go_on(gone: str) -> None:
    left = "b" if gone == "a" else "a"
    drag = {"on": left, "force": ["-1*vx", "0", "0"]}
    world = run(World(model(PAIR, BOND, drag)), 0.2)
    world.remove(gone)
    speed, mass = world.twist(left).linear[0], world.mass(left)
    assert abs(speed) > 0.1
    assert run(world, 0.5).twist(left).linear[0] == pytest.approx(speed * math.exp(-0.5 / mass), rel=1e-8)


def test_a_law_without_a_value_makes_the_step_unstable_and_readings_stay_finite() -> None:
    law = {"on": "cart", "force": ["sqrt(1 - x)", "0", "0"]}
    world = World(model(CART, law, qpos="0.5"))
    with pytest.raises(Unstable):
        run(world, 5.0)
    calm = World(model(CART, law, qpos="0.5"))
    run(calm, 0.2)
    saved, before = calm.save(), state(calm)
    calm.place("cart", np.array([1.5, 0, 0]), {})
    assert np.isfinite(calm.pose("cart").position).all()
    assert np.isfinite(calm.twist("cart").linear).all()
    assert np.isfinite(calm.inertia("cart")).all()
    with pytest.raises(NoDifference):
        calm.acceleration("cart")
    with pytest.raises(Unstable):
        calm.step(1)
    calm.restore(saved)
    assert state(calm) == before
    assert np.isfinite(calm.acceleration("cart")).all()
    untouched = run(World(model(CART, law, qpos="0.5")), 0.2)
    assert state(run(calm, 0.1)) == state(run(untouched, 0.1))


@pytest.mark.parametrize(
    "force", ["1/(x - 0.5)", "exp(1000*(x + 0.5))", "1e308*10*x", "(x - 0.6)**0.5", "0*log(0.5 - x)"]
)
def test_every_kind_of_missing_value_is_found_unstable(force: str) -> None:
    world = World(model(CART, {"on": "cart", "force": [f"{force} if t > 0.1 else 0", "0", "0"]}, qpos="0.5"))
    with pytest.raises(Unstable):
        world.step(20)


def test_laws_may_use_the_same_names_for_different_things() -> None:
    one = {"on": "a", "with": {"o": "b"}, "constants": {"k": 3.0}, "let": {"d": "x - o_x"}, "force": ["-k*d", "0", "0"]}
    two = {"on": "b", "with": {"o": "a"}, "constants": {"k": 5.0}, "let": {"d": "x + o_y"}, "force": ["-k*d", "0", "0"]}
    other = json.loads(
        json.dumps(two).replace('"k', '"q').replace("-k", "-q").replace('"d"', '"e"').replace("*d", "*e")
    )
    assert other["let"] == {"e": "x + o_y"}
    assert state(run(World(model(PAIR, one, two)), 1.0)) == state(run(World(model(PAIR, one, other)), 1.0))


@pytest.mark.parametrize("damping", ["", 'damping="0.3"'])
def test_laws_of_one_body_add_up_as_one_law_does(damping: str) -> None:
    """If a body has only slide joints, the forces of its laws are added first and applied once."""
    pucks = PUCK.format(1, 0).replace("<joint", f"<joint {damping}") + PUCK.format(-1, 1).replace('"puck"', '"other"')
    parts = ["-0.7*x", "-0.3*vx**3", "0.11*sin(3*t)"]
    laws = [{"on": "puck", "with": {"o": "other"}, "force": [part, "0.2*o_y", "0"], "reaction": "o"} for part in parts]
    whole = {**laws[0], "force": ["+".join(parts), "0.2*o_y+0.2*o_y+0.2*o_y", "0"]}
    several, one = World(model(pucks, *laws, qvel="1 0 0 2")), World(model(pucks, whole, qvel="1 0 0 2"))
    for _ in range(5):
        a, b = run(several, 0.2).save().state, run(one, 0.2).save().state
        assert a.tobytes() == b.tobytes() if not damping else a == pytest.approx(b, rel=1e-12)


# Laws that a seed switches off


def test_a_law_with_factor_0_does_nothing_whatever_it_acts_on() -> None:
    absent = {"on": "a", "with": {"o": "b"}, "force": ["3*(x - o_x)", "vy", "1"], "reaction": "o", "factor": 0.0}
    turning = {"on": "b", "torque": ["1", "t", "-wx"], "factor": 0.0}
    alone, beside = World(model(PAIR, BOND)), World(model(PAIR, absent, BOND, turning))
    for _ in range(20):
        assert state(run(alone, 0.1)) == state(run(beside, 0.1))


def test_a_law_costs_the_same_arithmetic_whatever_was_drawn() -> None:
    """Compares the bytecode of compiled laws, because the duration of a step must not reveal hidden values."""

    def code(k: float, factor: float) -> tuple[bytes, tuple[object, ...]]:
        law = {"on": "cart", "constants": {"k": k}, "force": ["-k*vx if k else 2*k", "k**2", "0"], "factor": factor}
        world = World(model(CART, law))
        bound = laws_at_start(world._spec, world._model)
        assert bound is not None
        return bound._function.__code__.co_code, bound._function.__code__.co_consts

    assert code(3.0, 1.0) == code(0.0, 1.0) == code(3.0, 0.0)


def test_a_law_that_is_left_out_must_have_a_value_at_the_start_too() -> None:
    assert "laws[0].force[0]: division by zero" in refusal(
        CART, {"on": "cart", "force": ["1/x", "0", "0"], "factor": 0}
    )


# Where laws act


def test_worlds_with_different_laws_in_threads_run_as_each_alone_does() -> None:
    laws = [{"on": "a", "let": {"r": "hypot(x, y, z)"}, "force": [f"-{n}*x*r", "-y", "0"]} for n in range(1, 5)]
    worlds = [model(PAIR, law, dt=0.002) for law in laws] + [model(PAIR, dt=0.002, qvel="1 0 0 0 0 0 0 0 0 0 0 0")] * 2

    def end(mjcf: str) -> bytes:
        return state(run(World(mjcf), 4.0))

    alone = [end(mjcf) for mjcf in worlds]
    with ThreadPoolExecutor(len(worlds)) as threads:
        assert list(threads.map(end, worlds)) == alone
    assert len(set(alone)) == 5


def test_worlds_with_laws_come_and_go_while_another_one_runs() -> None:
    """With MuJoCo's Python callback this test would fail: removing it during a step raises an error in that step."""

    def come_and_go() -> None:
        for _ in range(100):
            World(model(PAIR, SPRING)).step(1)

    with ThreadPoolExecutor(1) as thread:
        coming = thread.submit(come_and_go)
        running = World(model(PAIR))
        while not coming.done():
            running.step(200)
        coming.result()


CALLBACK = """
import gc, sys, mujoco
from physment_mcp.errors import SceneError
from physment_mcp.world import World

def installed():
    gc.collect()
    return mujoco.get_mjcb_passive() is not None

plain, lawful, wrong = sys.argv[1:]
world = World(plain)
world.step(10)
assert not installed()
try:
    World(wrong)
except SceneError:
    pass
else:
    raise AssertionError
assert not installed()
first, second = World(lawful), World(lawful)
assert installed()
world.step(10)
del first
assert installed()
saved = second.save()
second.remove("b")
assert installed()
del second
assert installed()
del saved
assert not installed()
world.step(10)
"""


_WHERE_THE_ENGINE_GIVES_UP = """
from physment_mcp.errors import Unstable
from physment_mcp.world import World

law = '[{"on": "b0", "constants": {"c": 0.001}, "force": ["-c*vx", "0", "0"]}]'
boxes = "".join(
    f"<body name='b{i}' pos='{0.15 * i} 0 {0.6 + 0.4 * i}'><freejoint/><geom type='box' size='.1 .1 .13'/></body>"
    for i in range(6)
)
world = World(
    f"<mujoco><size memory='30K'/><custom><text name='laws' data='{law}'/></custom>"
    f"<worldbody><geom type='plane' size='5 5 .1'/>{boxes}</worldbody></mujoco>"
)
try:
    world.step(2000)
except Unstable:
    print(f"refused at {world.time}")
"""
"""A model with a law, and with too little memory for its contacts: the engine ends such a step with an error."""


def test_an_error_of_the_engine_in_a_step_with_laws_is_a_refusal_and_not_the_end_of_the_process() -> None:
    words = [sys.executable, "-c", _WHERE_THE_ENGINE_GIVES_UP]
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=120)
    assert (done.returncode, done.stdout) == (0, "refused at 0.0\n")


def test_the_engine_calls_us_only_while_a_world_with_laws_lives() -> None:
    """Runs in its own process, because worlds of other tests may exist in this one."""
    worlds = [model(PAIR), model(PAIR, BOND), model(CART, {"on": "cart", "force": ["1/x", "0", "0"]})]
    subprocess.run([sys.executable, "-c", CALLBACK, *worlds], check=True)


def test_all_data_of_worlds_are_made_where_laws_can_find_them() -> None:
    room = Path(physment_mcp.world.__file__).parent
    made = {
        (path.name, of)
        for path in room.glob("*.py")
        for of in re.findall(r"MjData\((.*?)\)", path.read_text(encoding="utf-8"))
    }
    assert made == {("passive.py", "model"), ("loading.py", "with_keys")}


# What is refused


def refusal(bodies: str, *laws: Any, rest: str = "", qpos: str = "") -> str:
    with pytest.raises(SceneError) as error:
        World(model(bodies, *laws, rest=rest, qpos=qpos))
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"on": "ghost"}, "laws[1] on ghost: the model has no body 'ghost'"),
        ({"with": {"o": "ghost"}}, "laws[1] on cart: the model has no body 'ghost'"),
        ({"on": 3}, "laws[1] must be an object with `on`"),
        ({"forces": NONE}, "laws[1] must be an object with `on`"),
        ({"with": []}, "laws[1].with must be an object"),
        ({"with": {"o-": "cart"}}, "laws[1].with: a key must be a plain name"),
        ({"let": {"a": 1}}, "laws[1].let must be an object whose values are texts"),
        ({"constants": {"k": "1"}}, "laws[1].constants must be"),
        ({"constants": {"k": math.nan}}, "laws[1].constants must be"),
        ({"factor": "1"}, "laws[1].factor must be a finite number"),
        ({"factor": math.inf}, "laws[1].factor must be a finite number"),
        ({"force": ["0", "0"]}, "laws[1].force must be a list of three expressions"),
        ({"force": "000"}, "laws[1].force must be a list of three expressions"),
        ({"torque": [0, 0, 0]}, "laws[1].torque must be a list of three expressions"),
        ({"force": ["0", "0", "0"], "reaction": "o"}, "laws[1].reaction must be a key of `with`"),
        ({"force": ["0", "q", "0"]}, "laws[1] on cart: force[1]: the name 'q' is unknown here"),
        ({"torque": ["0", "0", "angle"]}, "laws[1] on cart: torque[2]: the name 'angle' is unknown here"),
        ({"constants": {"x": 1}}, "laws[1] on cart: constants.x: the name 'x' has a meaning already"),
        ({"let": {"a": "b", "b": "1"}}, "laws[1] on cart: let.a: the name 'b' is unknown here"),
        ({"force": ["1/x", "0", "0"]}, "laws[1].force[0]: division by zero at the start"),
        ({"let": {"r": "1/(t + vx)"}}, "laws[1].let.r: division by zero at the start"),
        ({"force": ["0", "0", "log(x - 1)"]}, "laws[1].force[2]: a function or a power is not defined"),
        ({"force": ["0", "exp(1000)", "0"]}, "laws[1].force[1]: a number becomes too large at the start"),
        ({"force": ["0", "1e308*10", "0"]}, "laws[1].force[1]: the value is inf at the start"),
    ],
)
def test_a_wrong_law_is_refused_with_its_place_and_the_reason(change: dict[str, Any], reason: str) -> None:
    right = {"on": "cart", "force": NONE}
    assert reason in refusal(CART, right, {**right, **change})


def test_a_law_without_force_and_torque_is_refused() -> None:
    assert refusal(CART, {"on": "cart"}) == "laws[0] has neither `force` nor `torque`"


def test_a_constant_that_is_true_or_false_counts_as_1_or_0() -> None:
    law = {"on": "cart", "constants": {"on": True, "off": False}, "force": ["4*on + 2*off", "0", "0"]}
    assert run(World(model(CART, law)), 1.0).twist("cart").linear[0] == pytest.approx(2, rel=1e-9)


def test_the_angle_of_a_body_with_two_hinges_is_unknown() -> None:
    two = ARM.replace("<joint", '<joint type="hinge" axis="1 0 0"/><joint', 1)
    assert "'spin' is unknown" in refusal(two, {"on": "arm", "torque": ["spin", "0", "0"]})


def test_laws_are_refused_where_passive_forces_are_disabled() -> None:
    older = "mjDSBL_PASSIVE" in mujoco.mjtDisableBit.__members__
    flag = 'passive="disable"' if older else 'spring="disable" damper="disable"'
    flags = f"<option><flag {flag}/></option>"
    assert "disables passive forces" in refusal(CART, {"on": "cart", "force": NONE}, rest=flags)


@pytest.mark.parametrize("text", ["{", "{}", "3", '[{"on": "cart"}', "[3]"])
def test_a_text_that_is_no_list_of_laws_is_refused(text: str) -> None:
    custom = f'<custom><text name="laws" data={quoteattr(text)}/></custom>'
    assert "laws" in refusal(CART, rest=custom)


def test_the_start_state_of_the_scene_decides_whether_a_law_has_a_value() -> None:
    law = {"on": "cart", "force": ["1/x", "0", "0"]}
    assert run(World(model(CART, law, qpos="0.5")), 0.1).centre("cart")[0] > 0.5
    assert "division by zero" in refusal(CART, law, qpos="0")
