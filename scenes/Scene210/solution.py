"""Scene 210: learn the mass, let the puck glide at many speeds and places, fit each law to the course, predict."""

import numpy as np

from scenes.courses import Laws
from scenes.protocol import answer, call
from scenes.pucks import HEAVY_KG, PuckFloor, force_on_puck, heavy_puck

_COMMON = ("m", "c", "p", "b", "quiet")
STRUCTURES = {"line": (*_COMMON, "where", "ratio"), "place": (*_COMMON, "slope"), "time": (*_COMMON, "growth")}
BOX = {
    "m": (0.2, 8.0),
    "c": (0.4, 4.0),
    "p": (1.0, 2.6),
    "b": (-2.4, 2.4),
    "quiet": (0.2, 1.2),
    "where": (1.0, 2.2),
    "ratio": (1.2, 4.5),
    "slope": (0.15, 1.4),
    "growth": (0.02, 0.3),
}
FAST_M_S, FAR_M, LATE_S = 20.0, 6.5, 40.0
STEP_M = 0.2


def _quiet(structure, knobs, time, x, y):
    """The speed below which nothing acts."""
    if structure == "line":
        shape = 1 + (knobs["ratio"] - 1) * (0.5 + 0.5 * np.tanh((x - knobs["where"]) / STEP_M))
    elif structure == "place":
        shape = 1 + knobs["slope"] * np.maximum(np.hypot(x, y) - 1, 0.0)
    else:
        shape = 1 + knobs["growth"] * time
    return knobs["quiet"] * shape


def _rates(structure, knobs, time, state, force):
    """Time derivative of the state: a drag and a force across the motion above the quiet speed."""
    x, y, vx, vy = state
    speed = np.sqrt(vx**2 + vy**2 + 1e-12)
    excess = np.maximum(speed - _quiet(structure, knobs, time, x, y), 1e-9)
    drag, turn = knobs["c"] * excess ** knobs["p"] / speed, knobs["b"] * excess / speed
    return np.array(
        [vx, vy, force[0] / knobs["m"] + turn * vy - drag * vx, force[1] / knobs["m"] - turn * vx - drag * vy]
    )


def predict(structure, knobs):
    """Resistance and force of the guide at speed; quiet speed late and far away."""
    excess = FAST_M_S - _quiet(structure, knobs, 0.0, 0.0, 0.0)
    return [
        float(knobs["m"] * knobs["c"] * excess ** knobs["p"]),
        float(-knobs["m"] * knobs["b"] * excess),
        float(_quiet(structure, knobs, LATE_S, FAR_M, 0.0)),
    ]


def measure(engine, knobs):
    """The same from forces on the puck in the engine."""
    fast = force_on_puck(engine, (0.0, 0.0), (0.0, FAST_M_S))
    heavy = heavy_puck(engine)
    heavy.step(heavy.whole_steps(LATE_S))
    low, high = 0.0, 10.0
    while high - low > 1e-3:
        middle = (low + high) / 2
        heavy.place("object_1", np.array([FAR_M, 0.0, 0.05]), {})
        heavy.set_velocity("object_1", np.array([0.0, middle, 0.0]))
        heavy.step(1)
        acts = np.hypot(*(heavy.twist("object_1").linear[:2] - (0.0, middle))) * HEAVY_KG / heavy.timestep > 1e-4
        low, high = (low, middle) if acts else (middle, high)
    return [float(-fast[1]), float(-fast[0]), low]


def naive(knobs):
    """The quiet speed is the same everywhere and always; the forces are in proportion to the speed."""
    resisted, across, _ = predict(knobs["kind"], knobs)
    quiet = knobs["quiet"]
    return {"the same": [resisted, across, quiet], "linear": [knobs["m"] * knobs["c"] * FAST_M_S, across, quiet]}


def stage(task):
    """Push hard; else push once and compare."""
    yield [call("apply_force", object_id="object_1", force_vector=[0, 100, 0]), call("step", duration=1)]
    yield [call("apply_force", object_id="object_1", force_vector=[0, 2, 0]), call("step", duration=1)]
    seen = yield [call("get_velocity", object_id="object_1")]
    vx, vy, _ = seen[0]["velocity"]
    yield [answer([40 / max(vy, 0.01), -20 * vx, 0.5])]


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(0.0, 0.0, 0.0, 0.0),
    sigma=(0.003, 0.003, 0.007, 0.007),
    longest_s=0.1,
    starts=500,
    tried=4,
    rounds=15,
)
FLOOR = PuckFloor(
    laws=LAWS,
    predict=predict,
    targets=((2.7, 0.3), (1.3, 1.8), (2.6, 0.8), (-2.0, 0.6), (2.7, -0.6), (0.5, -2.4)),
    near_m=1.0,
    safe_m=2.8,
    haste=2.9,
    leg_s=0.9,
    slowed=0.75,
    coasts_s=0.7,
)
solve, batch, fit = FLOOR.solve, FLOOR.batch, FLOOR.fit
