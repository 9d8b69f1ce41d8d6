"""Scene 203: learn the mass, lead the puck and let it coast, fit laws with a memory to the course, predict."""

import numpy as np

from scenes.courses import Laws, force, position, recorded, velocity
from scenes.protocol import answer, call

_COMMON = ("m", "c", "p", "q", "lag")
STRUCTURES = {
    "against": (*_COMMON, "k"),
    "along": (*_COMMON, "k"),
    "aside": (*_COMMON, "turn"),
}
BOX = {
    "m": (0.2, 8.0),
    "c": (0.25, 3.0),
    "p": (1.1, 2.8),
    "k": (0.25, 2.5),
    "q": (0.4, 1.9),
    "lag": (0.6, 8.0),
    "turn": (-2.0, 2.0),
}
START = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
SIGMA_M, SIGMA_M_S = 0.002, 0.005
LIGHTEST_KG, HEAVIEST_KG, HASTE, LEG_S, LEGS, LOOKS = 0.3, 6.0, 2.9, 0.8, 19, 2
TARGETS = ((1.6, 0.6), (-1.5, -0.7), (0.3, 1.6), (0.4, -1.7))
NEAR_M, SLOWED, COASTS_S, SAFE_M = 0.6, 0.75, 0.7, 1.9
FAST_M_S, LED_M_S, LATER_S = 15.0, 5.0, 3.0
HEAVY_KG = 1e6


def _rates(structure, knobs, time, state, force):
    """Time derivative of the state, which ends with the velocity that is remembered."""
    _, _, vx, vy, ux, uy = state
    drag = knobs["c"] * np.sqrt(vx**2 + vy**2 + 1e-12) ** (knobs["p"] - 1)
    size = np.sqrt(ux**2 + uy**2 + 1e-8) ** (knobs["q"] - 1)
    if structure == "aside":
        fx, fy = -knobs["turn"] * size * uy, knobs["turn"] * size * ux
    else:
        sign = knobs["k"] if structure == "along" else -knobs["k"]
        fx, fy = sign * size * ux, sign * size * uy
    return np.array(
        [
            vx,
            vy,
            force[0] / knobs["m"] + fx - drag * vx,
            force[1] / knobs["m"] + fy - drag * vy,
            (vx - ux) / knobs["lag"],
            (vy - uy) / knobs["lag"],
        ]
    )


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=START,
    sigma=(SIGMA_M, SIGMA_M, SIGMA_M_S, SIGMA_M_S),
    longest_s=0.25,
    starts=500,
    tried=4,
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
    """Resistance at speed without a past; force of the past right after a stop, and later."""
    stopped = knobs["m"] * (abs(knobs["turn"]) if structure == "aside" else knobs["k"]) * LED_M_S ** knobs["q"]
    return [
        float(knobs["m"] * knobs["c"] * FAST_M_S ** knobs["p"]),
        float(stopped),
        float(stopped * np.exp(-knobs["q"] * LATER_S / knobs["lag"])),
    ]


def _push(force, duration):
    """A push, looked at in even intervals."""
    look = round(duration / LOOKS / 0.005) * 0.005
    eyes = [call("get_position", object_id="object_1"), call("get_velocity", object_id="object_1")]
    push = call("apply_force", object_id="object_1", force_vector=[*np.round(force, 3).tolist(), 0.0])
    return [push, *([call("step", duration=look), *eyes] * LOOKS)]


def _mass(readings):
    """Mass so far, as if there were a drag and a force across in proportion to the speed, and a uniform force."""
    course = _course(readings)
    durations, after = course.durations, course.readings[:, 2:4]
    before = np.vstack([[0.0, 0.0], after[:-1]])
    (fx, fy), (vx, vy), ones, none = (
        course.controls[:, :2].T,
        (before + after).T / 2,
        np.ones_like(durations),
        0 * durations,
    )
    rows = np.concatenate([np.array([fx, -vx, vy, ones, none]).T, np.array([fy, -vy, -vx, none, ones]).T])
    rows *= np.tile(durations, 2)[:, None] / SIGMA_M_S
    changes = (after - before).T.ravel() / SIGMA_M_S
    found = np.linalg.lstsq(np.vstack([rows, 0.5 * np.eye(5)]), np.concatenate([changes, np.zeros(5)]), rcond=None)[0]
    return float(1 / np.clip(found[0], 1 / HEAVIEST_KG, 1 / LIGHTEST_KG))


def _aimed(place, velocity, target):
    """Of many pushes per kilogram, the one that brings the puck to rest nearest to the target, but not far out."""
    angles = np.linspace(0, 2 * np.pi, 25)[:-1]
    pushes = np.concatenate(
        [size * HASTE * np.array([np.cos(angles), np.sin(angles)]).T for size in (0.25, 0.5, 0.75, 1.0)]
    )
    after = SLOWED * (velocity + LEG_S * pushes)
    rest = place + LEG_S * (velocity + after) / 2 + COASTS_S * after
    return pushes[np.argmin(np.hypot(*(rest - target).T) + 10 * np.maximum(np.hypot(*rest.T) - SAFE_M, 0.0))]


def solve(task):
    """Begin gently, then lead the puck to and fro with forces that suit its mass, looking twice during each push."""
    seen, place, velocity, targets, mass = [], np.zeros(2), np.zeros(2), list(TARGETS), LIGHTEST_KG
    for _ in range(LEGS):
        if np.hypot(*(targets[0] - place)) < NEAR_M:
            targets = targets[1:] + targets[:1]
        calls = _push(mass * _aimed(place, velocity, targets[0]), LEG_S)
        readings = yield calls
        seen += zip(calls, readings, strict=True)
        place, velocity = np.array(readings[-2]["position"][:2]), np.array(readings[-1]["velocity"][:2])
        mass = min(_mass(seen), 3 * mass)
    yield [answer(_best(seen))]


def batch(task):
    """Pushes to and fro of fixed sizes and lengths, and the same fit."""
    calls = [asked for x, y, lasting in BATCH for asked in _push(np.array([x, y]), lasting)]
    readings = yield calls
    yield [answer(_best(list(zip(calls, readings, strict=True))))]


def _force(engine, place, speed=(0.0, 0.0), time=0.0):
    """Force on the puck at a place, a velocity and a time, which a huge inertia keeps, in the engine."""
    heavy = engine.changed({"joint[object_1_x].armature": HEAVY_KG, "joint[object_1_y].armature": HEAVY_KG})
    heavy.place("gate", np.array([0.0, 0.0, 1.0]), {})
    heavy.step(heavy.whole_steps(time))
    half = np.array(speed) * heavy.timestep / 2
    heavy.place("object_1", np.array([*(np.array(place) - half), 0.05]), {})
    heavy.set_velocity("object_1", np.array([*speed, 0.0]))
    before = heavy.twist("object_1").linear
    heavy.step(1)
    return (heavy.twist("object_1").linear - before)[:2] * HEAVY_KG / heavy.timestep


def measure(engine, knobs):
    """The same from forces on the puck in the engine."""
    fast = -_force(engine, (0.0, 0.0), (FAST_M_S, 0.0))[0]
    heavy = engine.changed({"joint[object_1_x].armature": HEAVY_KG, "joint[object_1_y].armature": HEAVY_KG})
    heavy.place("gate", np.array([0.0, 0.0, 1.0]), {})
    heavy.set_velocity("object_1", np.array([LED_M_S, 0.0, 0.0]))
    heavy.step(heavy.whole_steps(8 * knobs["lag"]))
    heavy.set_velocity("object_1", np.zeros(3))
    held = []
    for lasting in (0.0, LATER_S - heavy.timestep):
        heavy.step(heavy.whole_steps(lasting))
        before = heavy.twist("object_1").linear
        heavy.step(1)
        held.append(np.hypot(*(heavy.twist("object_1").linear - before)[:2]) * HEAVY_KG / heavy.timestep)
    return [float(fast), float(held[0]), float(held[1])]


def naive(knobs):
    """No past: what is held feels nothing; resistance in proportion to the speed."""
    fast, stopped, _ = _predictions(knobs["kind"], knobs)
    return {"no past": [fast, 0.0, 0.0], "forgets nothing": [fast, stopped, stopped]}


def stage(task):
    """Push as hard as one can, stop and look."""
    yield [call("apply_force", object_id="object_1", force_vector=[60, 0, 0]), call("step", duration=1)]
    yield [call("apply_force", object_id="object_1", force_vector=[3, 0, 0]), call("step", duration=1)]
    yield [call("apply_force", object_id="object_1", force_vector=[0, 0, 0]), call("step", duration=1)]
    seen = yield [call("get_velocity", object_id="object_1")]
    speed = float(np.hypot(*seen[0]["velocity"][:2]))
    yield [answer([60.0 * speed, 6.0 * speed, 1.0 * speed])]


BATCH = (
    (0.5, 0.0, 1.0),
    (-1.0, 0.3, 1.0),
    (1.5, -0.5, 1.0),
    (-2.5, 0.0, 0.8),
    (4.0, 0.5, 0.8),
    (-6.0, 0.0, 0.8),
    (0.0, 0.0, 1.6),
    (6.0, -4.0, 0.8),
)
