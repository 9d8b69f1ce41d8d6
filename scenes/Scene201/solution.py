"""Scene 201: lead the puck to places up to the rim, fit each law to the whole course, predict."""

import numpy as np

from scenes.courses import Laws, force, position, recorded, velocity
from scenes.protocol import answer, call

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
GREATEST_N, LEG_S, LEGS, LOOKS, STIFF, CALM = 2.9, 1.0, 19, 2, 2.5, 1.5
TARGETS = ((5.1, 0.5), (2.4, -0.5), (5.2, -0.3), (-1.0, 0.6), (5.2, 0.4), (3.0, -0.8), (5.0, 0.6))
NEAR_M, SAFE_M = 0.7, 5.1
FAR_FORCE_N, FAST_M_S, FAR_M, SLOW_M_S = 40.0, 4.0, 8.0, 1.0
HEAVY_KG = 1e6
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


def _course(readings):
    """Pushes and what was read after them."""
    seen = [*(position("object_1", axis) for axis in (0, 1)), *(velocity("object_1", axis) for axis in (0, 1))]
    return recorded(readings, [force("object_1", axis) for axis in (0, 1)], seen)


def fit(readings, structure):
    """Predictions of the best fit of a structure."""
    return _predictions(structure, LAWS.fitted(_course(readings), structure)[1])


def _best(readings):
    """Predictions of the structure that fits best, with a penalty for each knob."""
    return _predictions(*LAWS.best(_course(readings)))


def structure(knobs):
    """Label of the drawn structure."""
    return knobs["kind"]


def theory(knobs):
    """Predictions from the drawn law."""
    return _predictions(knobs["kind"], knobs)


def _predictions(structure, knobs):
    """Guided speed under the far force; the guide's force at speed and at the far place."""
    return [
        float((FAR_FORCE_N / knobs["c"]) ** (1 / knobs["p"])),
        float(knobs["b"] * _shape(structure, knobs, 0.0) * FAST_M_S ** knobs["q"]),
        float(knobs["b"] * _shape(structure, knobs, FAR_M) * SLOW_M_S ** knobs["q"]),
    ]


def _push(force, duration):
    """A push, looked at in even intervals."""
    look = round(duration / LOOKS / 0.005) * 0.005
    eyes = [call("get_position", object_id="object_1"), call("get_velocity", object_id="object_1")]
    push = call("apply_force", object_id="object_1", force_vector=[*np.round(force, 3).tolist(), 0.0])
    return [push, *([call("step", duration=look), *eyes] * LOOKS)]


def solve(task):
    """Lead the puck to and fro, mostly on the side that the question is about, looking twice during each push."""
    seen, place, velocity, targets = [], np.zeros(2), np.zeros(2), list(TARGETS)
    for _ in range(LEGS):
        if np.hypot(*(targets[0] - place)) < NEAR_M:
            targets = targets[1:] + targets[:1]
        force, ahead = STIFF * (targets[0] - place) - CALM * velocity, place + LEG_S * velocity
        if np.hypot(*ahead) > SAFE_M:
            force = -GREATEST_N * ahead
        calls = _push(force * min(1.0, GREATEST_N / np.hypot(*force)), LEG_S)
        readings = yield calls
        seen += zip(calls, readings, strict=True)
        place, velocity = np.array(readings[-2]["position"][:2]), np.array(readings[-1]["velocity"][:2])
    yield [answer(_best(seen))]


def batch(task):
    """Pushes to and fro of fixed lengths, and the same fit."""
    calls = [asked for x, y, lasting in BATCH for asked in _push(np.array([x, y]), lasting)]
    readings = yield calls
    yield [answer(_best(list(zip(calls, readings, strict=True))))]


def _force(engine, place, velocity=(0.0, 0.0)):
    """Force on the puck at a place and a velocity, which a huge inertia keeps, in the engine."""
    heavy = engine.changed({"joint[object_1_x].armature": HEAVY_KG, "joint[object_1_y].armature": HEAVY_KG})
    half = np.array(velocity) * heavy.timestep / 2
    heavy.place("gate", np.array([0.0, 0.0, 1.0]), {})
    heavy.place("object_1", np.array([*(np.array(place) - half), 0.05]), {})
    heavy.set_velocity("object_1", np.array([*velocity, 0.0]))
    before = heavy.twist("object_1").linear
    heavy.step(1)
    return (heavy.twist("object_1").linear - before)[:2] * HEAVY_KG / heavy.timestep


def measure(engine, knobs):
    """The same three situations in the engine, without the rim."""
    guided = engine.changed({"joint[object_1_y].armature": 1e4 * HEAVY_KG})
    guided.place("gate", np.array([0.0, 0.0, 1.0]), {})
    guided.push("object_1", force=np.array([FAR_FORCE_N, 0.0, 0.0]))
    guided.step(guided.whole_steps(10.0))
    return [
        float(guided.twist("object_1").linear[0]),
        float(-_force(engine, (0.0, 0.0), (FAST_M_S, 0.0))[1]),
        float(-_force(engine, (FAR_M, 0.0), (SLOW_M_S, 0.0))[1]),
    ]


def naive(knobs):
    """All forces in proportion to the speed; the same everywhere."""
    low = knobs["c"] * 1.0
    here = knobs["b"] * _shape(knobs["kind"], knobs, 0.0)
    return {
        "linear": [FAR_FORCE_N / low, here * FAST_M_S, _predictions(knobs["kind"], knobs)[2]],
        "everywhere the same": [*_predictions(knobs["kind"], knobs)[:2], here],
    }


def stage(task):
    """Push as the question says."""
    yield [call("apply_force", object_id="object_1", force_vector=[FAR_FORCE_N, 0, 0]), call("step", duration=10)]
    yield [call("apply_force", object_id="object_1", force_vector=[3, 0, 0]), call("step", duration=1)]
    speed = yield [call("get_velocity", object_id="object_1")]
    vx, vy, _ = speed[0]["velocity"]
    yield [answer([vx * FAR_FORCE_N / 3, -vy * FAST_M_S, -vy])]


BATCH = (
    (2.9, 0.3, 1.2),
    (-1.0, -0.3, 1.2),
    (1.5, -0.3, 1.4),
    (-1.0, 0.3, 1.6),
    (-1.0, 0.0, 1.0),
    (2.9, 0.3, 1.6),
    (0.0, 0.0, 1.6),
    (-2.9, 0.3, 1.6),
)
