"""Scene 217: learn the mass, steer a puck that speeds up by itself, fit each law to the course, predict."""

import numpy as np

from scenes.courses import Laws
from scenes.protocol import answer, call
from scenes.pucks import PuckFloor

STRUCTURES = {
    "step": ("m", "a", "b", "p", "where", "ratio"),
    "ramp": ("m", "a", "b", "p", "where", "slope"),
    "wave": ("m", "a", "b", "p", "depth", "length", "phase"),
}
BOX = {
    "m": (0.13, 13.0),
    "a": (0.15, 2.2),
    "b": (0.1, 1.6),
    "p": (1.8, 4.0),
    "where": (1.8, 3.5),
    "ratio": (0.15, 4.5),
    "slope": (0.2, 1.1),
    "depth": (0.25, 1.0),
    "length": (3.0, 6.5),
    "phase": (-3.2, 9.5),
}
FAR_FORCE_N, FAR_M, SLOW_M_S, QUICK_M_S = 100.0, 5.0, 0.001, 0.01
STEP_M, BEND_M = 0.2, 0.3
HEAVY_KG = 1e6


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


def structure(knobs):
    """Label of the drawn structure."""
    return knobs["kind"]


def theory(knobs):
    """Predictions from the drawn law."""
    return _predictions(knobs["kind"], knobs)


def _predictions(structure, knobs):
    """Speed under the far force, own speed at the far place, time of growth at the origin."""
    here, there = (float(knobs["a"] * _shape(structure, knobs, x)) for x in (0.0, FAR_M))
    b, p = float(knobs["b"]), float(knobs["p"])
    low, high = 0.0, 100.0
    for _ in range(60):
        middle = (low + high) / 2
        # Beyond its own speed the brake outweighs the drive and the push.
        low, high = (middle, high) if b * middle**p - here * middle < FAR_FORCE_N / knobs["m"] else (low, middle)
    return [low, float((max(there, 1e-9) / b) ** (1 / (p - 1))), float(np.log(QUICK_M_S / SLOW_M_S) / here)]


def measure(engine, knobs):
    """The three situations in the engine, in guides and without the rim."""
    results = []
    for place, speed, pushed, lasting in ((0.0, 0.0, FAR_FORCE_N, 20.0), (FAR_M, 0.1, 0.0, 60.0)):
        guided = engine.changed({"joint[object_1_x].armature": 1e6 * HEAVY_KG})
        guided.place("gate", np.array([0.0, 0.0, 1.0]), {})
        guided.place("object_1", np.array([place, 0.0, 0.05]), {})
        guided.set_velocity("object_1", np.array([0.0, speed, 0.0]))
        guided.push("object_1", force=np.array([0.0, pushed, 0.0]))
        guided.step(guided.whole_steps(lasting))
        results.append(float(guided.twist("object_1").linear[1]))
    guided = engine.changed({"joint[object_1_x].armature": 1e6 * HEAVY_KG})
    guided.place("gate", np.array([0.0, 0.0, 1.0]), {})
    guided.set_velocity("object_1", np.array([0.0, SLOW_M_S, 0.0]))
    before = after = SLOW_M_S
    while after < QUICK_M_S:
        guided.step(1)
        before, after = after, float(guided.twist("object_1").linear[1])
    share = (QUICK_M_S - before) / (after - before)
    return [*results, guided.time - guided.timestep * (1 - share)]


def naive(knobs):
    """As at the origin everywhere; or a common drag, from the own speed."""
    push, own, growth = _predictions(knobs["kind"], knobs)
    here = float(knobs["a"] * _shape(knobs["kind"], knobs, 0.0))
    speed = (here / knobs["b"]) ** (1 / (knobs["p"] - 1))
    return {
        "everywhere the same": [push, speed, growth],
        "linear": [FAR_FORCE_N / knobs["m"] / knobs["b"], own, growth],
    }


def stage(task):
    """Push as the question says; else let it run by itself."""
    yield [call("apply_force", object_id="object_1", force_vector=[0, FAR_FORCE_N, 0]), call("step", duration=2)]
    yield [call("apply_force", object_id="object_1", force_vector=[0.5, 0, 0]), call("step", duration=0.4)]
    yield [call("apply_force", object_id="object_1", force_vector=[0, 0, 0]), call("step", duration=2.0)]
    seen = yield [call("get_velocity", object_id="object_1")]
    speed = float(np.hypot(*seen[0]["velocity"][:2]))
    yield [answer([speed + FAR_FORCE_N, speed, 2.4])]


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(0.0, 0.0, 0.0, 0.0),
    sigma=(0.00105, 0.00105, 0.0025, 0.0025),
    longest_s=0.08,
    starts=500,
    tried=3,
    rounds=25,
)
FLOOR = PuckFloor(
    laws=LAWS,
    predict=_predictions,
    targets=((3.9, 0.3), (1.8, -0.5), (3.9, -0.4), (-1.5, 0.6), (3.9, 0.6), (0.5, -0.8)),
    near_m=0.8,
    safe_m=3.9,
    haste=3.2,
    lightest_kg=0.2,
    heaviest_kg=9.0,
    leg_s=0.7,
    slowed=0.95,
    coasts_s=0.6,
    fixed_pushes=(
        (0.4, 0.1, 0.8),
        (-0.8, -0.1, 1.2),
        (1.6, 0.1, 1.2),
        (-1.2, 0.2, 1.0),
        (2.5, -0.2, 1.0),
        (-4.0, 0.2, 0.6),
        (5.0, 0.0, 0.8),
        (-6.0, 0.3, 0.8),
    ),
)
solve, batch, fit = FLOOR.solve, FLOOR.batch, FLOOR.fit
