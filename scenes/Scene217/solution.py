"""Scene 217: learn the mass, steer a puck that speeds up by itself, fit each law to the course, predict."""

import numpy as np

from scenes.courses import Laws
from scenes.protocol import answer, call
from scenes.pucks import PuckFloor, force_on_puck

STRUCTURES = {
    "step": ("m", "a", "b", "p", "where", "ratio"),
    "ramp": ("m", "a", "b", "p", "where", "slope"),
    "wave": ("m", "a", "b", "p", "depth", "length", "phase"),
}
BOX = {
    "m": (0.05, 25.0),
    "a": (0.15, 2.2),
    "b": (0.1, 1.6),
    "p": (1.8, 4.0),
    "where": (1.3, 2.8),
    "ratio": (0.15, 4.5),
    "slope": (0.25, 1.2),
    "depth": (0.25, 1.0),
    "length": (2.3, 5.2),
    "phase": (-3.2, 9.5),
}
FAST_M_S, FAR_M, SENT_M_S, LASTING_S, SLOW_M_S, QUICK_M_S = 8.0, 3.8, 0.1, 60.0, 0.001, 0.01
STEP_M, BEND_M = 0.2, 0.3
HEAVY_KG = 1e12


def _shape(structure, knobs, x):
    """The driving at a place, over its factor."""
    if structure == "step":
        return 1 + (knobs["ratio"] - 1) * (0.5 + 0.5 * np.tanh((x - knobs["where"]) / STEP_M))
    if structure == "ramp":
        beyond = x - knobs["where"]
        return 1 + knobs["slope"] * 0.5 * (beyond + np.sqrt(beyond**2 + BEND_M**2))
    return 1 + knobs["depth"] * np.sin(2 * np.pi * x / knobs["length"] + knobs["phase"])


def _rates(structure, knobs, time, state, force):
    """Time derivative of the state: along the motion a force that drives, and one that brakes more at higher speed."""
    x, _, vx, vy = state
    speed = np.sqrt(vx**2 + vy**2 + 1e-12)
    gain = knobs["a"] * _shape(structure, knobs, x) - knobs["b"] * speed ** (knobs["p"] - 1)
    return np.array([vx, vy, force[0] / knobs["m"] + gain * vx, force[1] / knobs["m"] + gain * vy])


def predict(structure, knobs):
    """Force that leads along the guide, own speed at the far place, time of growth at the origin."""
    here, there = (float(knobs["a"] * _shape(structure, knobs, x)) for x in (0.0, FAR_M))
    b, p = float(knobs["b"]), float(knobs["p"])
    led = float(knobs["m"]) * (b * FAST_M_S**p - here * FAST_M_S)
    return [led, float((max(there, 1e-9) / b) ** (1 / (p - 1))), float(np.log(QUICK_M_S / SLOW_M_S) / here)]


def measure(engine, knobs):
    """The three situations in the engine, in guides and without the rim."""
    led = -force_on_puck(engine, (0.0, 0.0), (0.0, FAST_M_S))[1]
    own = _sent(engine, FAR_M, SENT_M_S)
    own.step(own.whole_steps(LASTING_S))
    early = _sent(engine, 0.0, SLOW_M_S)
    before = after = SLOW_M_S
    while after < QUICK_M_S:
        early.step(1)
        before, after = after, float(early.twist("object_1").linear[1])
    share = (QUICK_M_S - before) / (after - before)
    return [float(led), float(own.twist("object_1").linear[1]), early.time - early.timestep * (1 - share)]


def _sent(engine, place, speed):
    """The scene with a puck that is sent off in a guide."""
    guided = engine.changed({"joint[object_1_x].armature": HEAVY_KG})
    guided.place("gate", np.array([0.0, 0.0, 1.0]), {})
    guided.place("object_1", np.array([place, 0.0, 0.05]), {})
    guided.set_velocity("object_1", np.array([0.0, speed, 0.0]))
    return guided


def naive(knobs):
    """As at the origin everywhere; or a common drag, from the own speed."""
    led, own, growth = predict(knobs["kind"], knobs)
    here = float(knobs["a"] * _shape(knobs["kind"], knobs, 0.0))
    speed = (here / knobs["b"]) ** (1 / (knobs["p"] - 1))
    return {
        "everywhere the same": [led, speed, growth],
        "linear": [knobs["m"] * knobs["b"] * FAST_M_S, own, growth],
    }


def stage(task):
    """Push as the question says; else let it run by itself."""
    yield [call("apply_force", object_id="object_1", force_vector=[0, 100, 0]), call("step", duration=2)]
    yield [call("apply_force", object_id="object_1", force_vector=[0.5, 0, 0]), call("step", duration=0.4)]
    yield [call("apply_force", object_id="object_1", force_vector=[0, 0, 0]), call("step", duration=2.0)]
    seen = yield [call("get_velocity", object_id="object_1")]
    speed = float(np.hypot(*seen[0]["velocity"][:2]))
    yield [answer([0.5 * FAST_M_S / speed, speed, 2.4])]


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(0.0, 0.0, 0.0, 0.0),
    sigma=(0.00165, 0.00165, 0.004, 0.004),
    longest_s=0.08,
    starts=500,
    tried=3,
    rounds=25,
)
FLOOR = PuckFloor(
    laws=LAWS,
    predict=predict,
    targets=((3.0, 0.3), (1.4, -0.5), (3.0, -0.4), (-1.2, 0.6), (3.0, 0.6), (0.4, -0.7)),
    near_m=0.7,
    safe_m=3.0,
    haste=3.2,
    lightest_kg=0.08,
    heaviest_kg=16.0,
    leg_s=0.6,
    slowed=0.95,
    coasts_s=0.6,
    rim_m=3.6,
    fixed_pushes=(
        (0.5, 0.1, 0.6),
        (-0.8, 0.0, 0.8),
        (1.6, 0.2, 0.8),
        (-2.2, -0.2, 0.8),
        (4.0, 0.0, 0.8),
        (-6.0, 0.3, 0.7),
        (12.0, 0.0, 0.7),
        (-20.0, 1.0, 0.7),
    ),
)
solve, batch, fit = FLOOR.solve, FLOOR.batch, FLOOR.fit
