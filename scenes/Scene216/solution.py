"""Scene 216: learn the mass, lead the puck at many speeds, fit each law to the course, predict."""

import numpy as np

from scenes.courses import Laws
from scenes.protocol import answer, call
from scenes.pucks import HEAVY_KG, PuckFloor, force_on_puck

_COMMON = ("m", "c", "p", "b", "knee", "ratio", "edge", "angle")
STRUCTURES = {"levels": _COMMON, "falls": _COMMON, "changes": _COMMON}
BOX = {
    "m": (0.2, 8.0),
    "c": (0.2, 2.5),
    "p": (1.1, 2.8),
    "b": (-3.5, 3.5),
    "knee": (0.4, 4.0),
    "ratio": (0.2, 3.0),
    "edge": (0.8, 2.1),
    "angle": (-0.9, 2.4),
}
FAST_M_S, FAR_FORCE_N, FAR_M, SLOW_M_S = 10.0, 120.0, 4.0, 1.0
TURN_BACK, STEP_M = 0.4, 0.15


def _turn(structure, knobs, speed, x, y):
    """Force across the motion over the speed, per kilogram."""
    ratio = speed / knobs["knee"]
    if structure == "levels":
        f = 1 / (1 + ratio)
    elif structure == "falls":
        f = 1 / (1 + ratio**2)
    else:
        f = 1 - TURN_BACK * ratio
    beyond = x * np.cos(knobs["angle"]) + y * np.sin(knobs["angle"]) - knobs["edge"]
    return knobs["b"] * f * (1 + (knobs["ratio"] - 1) * (0.5 + 0.5 * np.tanh(beyond / STEP_M)))


def _rates(structure, knobs, time, state, force):
    """Time derivative of the state."""
    x, y, vx, vy = state
    speed = np.sqrt(vx**2 + vy**2 + 1e-12)
    drag = knobs["c"] * speed ** (knobs["p"] - 1)
    turn = _turn(structure, knobs, speed, x, y)
    return np.array(
        [vx, vy, force[0] / knobs["m"] - drag * vx + turn * vy, force[1] / knobs["m"] - drag * vy - turn * vx]
    )


def predict(structure, knobs):
    """Force of the guide at speed; guided speed under the far force; force of the guide far away."""
    m = knobs["m"]
    return [
        float(m * _turn(structure, knobs, FAST_M_S, 0.0, 0.0) * FAST_M_S),
        float((FAR_FORCE_N / m / knobs["c"]) ** (1 / knobs["p"])),
        float(m * _turn(structure, knobs, SLOW_M_S, 0.0, FAR_M) * SLOW_M_S),
    ]


def measure(engine, knobs):
    """The same three situations in the engine, without the rim."""
    guided = engine.changed({"joint[object_1_y].armature": 1e4 * HEAVY_KG})
    guided.place("gate", np.array([0.0, 0.0, 1.0]), {})
    guided.push("object_1", force=np.array([FAR_FORCE_N, 0.0, 0.0]))
    guided.step(guided.whole_steps(15.0))
    return [
        float(-force_on_puck(engine, (0.0, 0.0), (FAST_M_S, 0.0))[1]),
        float(guided.twist("object_1").linear[0]),
        float(-force_on_puck(engine, (0.0, FAR_M), (SLOW_M_S, 0.0))[1]),
    ]


def naive(knobs):
    """All forces in proportion to the speed; a force across in proportion to the speed that is the same everywhere."""
    _, steady, far = predict(knobs["kind"], knobs)
    here = float(knobs["m"] * knobs["b"] * SLOW_M_S)
    return {
        "linear": [here * FAST_M_S, FAR_FORCE_N / knobs["m"] / knobs["c"], far],
        "everywhere the same": [here * FAST_M_S, steady, here],
    }


def stage(task):
    """Push as the question says; else with what one has."""
    yield [call("apply_force", object_id="object_1", force_vector=[FAR_FORCE_N, 0, 0]), call("step", duration=2)]
    yield [call("apply_force", object_id="object_1", force_vector=[3, 0, 0]), call("step", duration=1)]
    seen = yield [call("get_velocity", object_id="object_1")]
    vx, vy, _ = seen[0]["velocity"]
    yield [answer([-vy * FAST_M_S, vx * FAR_FORCE_N / 3, vy])]


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(0.0, 0.0, 0.0, 0.0),
    sigma=(0.0015, 0.0015, 0.0035, 0.0035),
    longest_s=0.1,
    starts=1200,
    tried=8,
    rounds=15,
)
FLOOR = PuckFloor(
    laws=LAWS,
    predict=predict,
    targets=((2.6, 0.6), (-0.3, 2.6), (2.3, -1.1), (0.9, 2.5), (2.7, 0.5), (-0.9, 2.4)),
    near_m=0.7,
    safe_m=2.6,
    haste=4.0,
    leg_s=0.85,
    wanders=0.5,
    patience=3,
    rim_m=3.3,
    coasts_s=0.7,
)
solve, batch, fit = FLOOR.solve, FLOOR.batch, FLOOR.fit
