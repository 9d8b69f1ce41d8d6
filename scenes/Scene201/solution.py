"""Scene 201: lead the puck to places up to the rim on either side, fit each law to the whole course, predict."""

import numpy as np

from scenes.courses import Laws
from scenes.protocol import answer, call
from scenes.pucks import HEAVY_KG, PuckFloor, force_on_puck

STRUCTURES = {
    "step": ("c", "p", "q", "b", "where", "ratio"),
    "ramp": ("c", "p", "q", "b", "where", "slope"),
    "wave": ("c", "p", "q", "b", "depth", "length", "phase"),
}
BOX = {
    "c": (0.3, 3.0),
    "p": (1.1, 2.9),
    "q": (0.4, 2.2),
    "b": (-1.8, 1.8),
    "where": (2.0, 4.5),
    "ratio": (0.1, 5.0),
    "slope": (-1.2, 1.2),
    "depth": (0.3, 1.2),
    "length": (4.0, 11.0),
    "phase": (-0.3, 6.6),
}
FAR_FORCE_N, FAST_M_S, FAR_M, SLOW_M_S = 40.0, 4.0, 8.0, 1.0
STEP_M = 0.2


def _shape(structure, knobs, x):
    """The sideways force at a place, over that at unit factor."""
    if structure == "step":
        return 1 + (knobs["ratio"] - 1) * (0.5 + 0.5 * np.tanh((x - knobs["where"]) / STEP_M))
    if structure == "ramp":
        return 1 + knobs["slope"] * np.maximum(x - knobs["where"], 0.0)
    return 1 + knobs["depth"] * np.sin(2 * np.pi * x / knobs["length"] + knobs["phase"])


def _rates(structure, knobs, time, state, force):
    """Time derivative of the state: drag against a power of the speed, and a force across the way that x changes."""
    x, _, vx, vy = state
    speed = np.sqrt(vx**2 + vy**2 + 1e-12)
    drag = knobs["c"] * speed ** (knobs["p"] - 1)
    turn = knobs["b"] * _shape(structure, knobs, x) * speed ** (knobs["q"] - 1)
    return np.array([vx, vy, force[0] - drag * vx + turn * vy, force[1] - drag * vy - turn * vx])


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(0.0, 0.0, 0.0, 0.0),
    sigma=(0.0025, 0.0025, 0.006, 0.006),
    longest_s=0.13,
    starts=300,
    tried=6,
    rounds=15,
)


def predict(structure, knobs):
    """Guided speed under the far force; the guide's force at speed and at the far place."""
    return [
        float((FAR_FORCE_N / knobs["c"]) ** (1 / knobs["p"])),
        float(knobs["b"] * _shape(structure, knobs, 0.0) * FAST_M_S ** knobs["q"]),
        float(knobs["b"] * _shape(structure, knobs, FAR_M) * SLOW_M_S ** knobs["q"]),
    ]


def measure(engine, knobs):
    """The same three situations in the engine, without the rim."""
    guided = engine.changed({"joint[object_1_y].armature": 1e4 * HEAVY_KG})
    guided.place("gate", np.array([0.0, 0.0, 1.0]), {})
    guided.push("object_1", force=np.array([FAR_FORCE_N, 0.0, 0.0]))
    guided.step(guided.whole_steps(10.0))
    return [
        float(guided.twist("object_1").linear[0]),
        float(-force_on_puck(engine, (0.0, 0.0), (FAST_M_S, 0.0))[1]),
        float(-force_on_puck(engine, (FAR_M, 0.0), (SLOW_M_S, 0.0))[1]),
    ]


def naive(knobs):
    """All forces in proportion to the speed; the same everywhere."""
    low = knobs["c"] * 1.0
    here = knobs["b"] * _shape(knobs["kind"], knobs, 0.0)
    return {
        "linear": [FAR_FORCE_N / low, here * FAST_M_S, predict(knobs["kind"], knobs)[2]],
        "everywhere the same": [*predict(knobs["kind"], knobs)[:2], here],
    }


def stage(task):
    """Push as the question says."""
    yield [call("apply_force", object_id="object_1", force_vector=[FAR_FORCE_N, 0, 0]), call("step", duration=10)]
    yield [call("apply_force", object_id="object_1", force_vector=[3, 0, 0]), call("step", duration=1)]
    speed = yield [call("get_velocity", object_id="object_1")]
    vx, vy, _ = speed[0]["velocity"]
    yield [answer([vx * FAR_FORCE_N / 3, -vy * FAST_M_S, -vy])]


FLOOR = PuckFloor(
    laws=LAWS,
    predict=predict,
    targets=((5.1, 0.5), (-5.1, -0.5), (5.2, -0.3), (-5.0, 0.6), (5.2, 0.4), (-5.0, -0.8), (5.0, 0.6)),
    near_m=0.7,
    safe_m=5.2,
    haste=2.9,
    lightest_kg=1.0,
    heaviest_kg=1.0,
    leg_s=1.1,
    wanders=0.5,
    rim_m=6.0,
    patience=8,
    fixed_pushes=(
        (2.9, 0.3, 1.2),
        (-1.0, -0.3, 1.2),
        (1.5, -0.3, 1.4),
        (-1.0, 0.3, 1.6),
        (-1.0, 0.0, 1.0),
        (2.9, 0.3, 1.6),
        (0.0, 0.0, 1.6),
        (-2.9, 0.3, 1.6),
    ),
)
solve, batch, fit = FLOOR.solve, FLOOR.batch, FLOOR.fit
