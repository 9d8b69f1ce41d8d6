"""Scene 206: learn the mass, lead the puck while the uniform force changes, fit each law to the course, predict."""

import numpy as np

from scenes.courses import Laws, force, position, recorded, velocity
from scenes.protocol import answer, call

_COMMON = ("m", "c", "p", "tilt", "angle")
STRUCTURES = {
    "turning": (*_COMMON, "rate"),
    "fading": (*_COMMON, "lasting"),
    "pulsing": (*_COMMON, "period", "depth", "phase"),
}
BOX = {
    "m": (0.3, 5.0),
    "c": (0.2, 3.0),
    "p": (1.1, 2.8),
    "tilt": (0.25, 2.5),
    "angle": (-0.4, 6.7),
    "period": (7.0, 45.0),
    "lasting": (9.0, 70.0),
    "rate": (-0.8, 0.8),
    "depth": (0.2, 1.3),
    "phase": (-0.4, 6.7),
}
START = (0.0, 0.0, 0.0, 0.0)
SIGMA_M, SIGMA_M_S = 0.005, 0.012
LIGHTEST_KG, HEAVIEST_KG, HASTE, LEG_S, LEGS, LOOKS = 0.4, 4.0, 2.9, 1.0, 19, 2
TARGETS = ((4.0, 1.5), (-3.5, -1.5), (0.5, 4.0), (1.0, -4.0))
NEAR_M, SLOWED, COASTS_S, SAFE_M = 1.2, 0.75, 0.7, 5.0
LATE_S, FAST_M_S, LONG_S = 35.0, 25.0, 60.0
HEAVY_KG = 1e6


def _tilt(structure, knobs, time):
    """Uniform force per kilogram at a time."""
    size, angle = knobs["tilt"], knobs["angle"]
    if structure == "turning":
        angle = angle + knobs["rate"] * time
    elif structure == "fading":
        size = size * np.exp(-time / knobs["lasting"])
    else:
        size = size * (1 + knobs["depth"] * np.sin(2 * np.pi * time / knobs["period"] + knobs["phase"]))
    return size * np.cos(angle), size * np.sin(angle)


def _rates(structure, knobs, time, state, force):
    """Time derivative of the state."""
    _, _, vx, vy = state
    ax, ay = _tilt(structure, knobs, time)
    drag = knobs["c"] * np.sqrt(vx**2 + vy**2 + 1e-12) ** (knobs["p"] - 1)
    return np.array([vx, vy, force[0] / knobs["m"] + ax - drag * vx, force[1] / knobs["m"] + ay - drag * vy])


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
    """Holding force late; resistance at speed; momentum given by the hand that holds."""
    times = np.linspace(0, LONG_S, 2001)
    held = knobs["m"] * (_tilt(structure, knobs, times)[1] + 0 * times)
    return [
        float(-knobs["m"] * _tilt(structure, knobs, LATE_S)[0]),
        float(knobs["m"] * knobs["c"] * FAST_M_S ** knobs["p"]),
        float(-np.sum(held[1:] + held[:-1]) / 2 * (times[1] - times[0])),
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
    heavy = engine.changed({"joint[object_1_x].armature": HEAVY_KG, "joint[object_1_y].armature": HEAVY_KG})
    heavy.step(heavy.whole_steps(LONG_S))
    return [
        float(-_force(engine, (0.0, 0.0), time=LATE_S)[0]),
        float((_force(engine, (0.0, 0.0)) - _force(engine, (0.0, 0.0), (FAST_M_S, 0.0)))[0]),
        float(-heavy.twist("object_1").linear[1] * HEAVY_KG),
    ]


def naive(knobs):
    """As at the start at all times; resistance in proportion to the speed."""
    late, fast, momentum = _predictions(knobs["kind"], knobs)
    ax, ay = (float(part) for part in _tilt(knobs["kind"], knobs, 0.0))
    return {
        "always the same": [-knobs["m"] * ax, fast, -knobs["m"] * ay * LONG_S],
        "linear": [late, knobs["m"] * knobs["c"] * FAST_M_S, momentum],
    }


def stage(task):
    """Wait as the question says; else hold against the first force."""
    yield [call("step", duration=LATE_S)]
    yield [call("step", duration=1.0)]
    seen = yield [call("get_velocity", object_id="object_1")]
    vx, vy, _ = seen[0]["velocity"]
    yield [answer([-vx, 100.0, -vy * LONG_S])]


BATCH = (
    (0.6, 0.0, 1.4),
    (-1.2, 0.5, 1.4),
    (2.5, -0.5, 1.4),
    (-4.0, 0.5, 1.4),
    (5.0, 0.0, 1.2),
    (-6.0, 2.0, 1.2),
    (0.0, 0.0, 2.0),
    (4.0, -4.0, 2.0),
)
