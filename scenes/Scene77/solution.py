"""Scene 77: spin the table gently, swing the slider wider and wider below the latch, fit, and pull the pin."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from scenes.courses import Channel, Course, Laws, position, recorded, refined, velocity
from scenes.protocol import answer, call

REST_M, LATCH_M, TORQUE, SPIN = 0.5, 1.0, 10.0, 7.0
STRUCTURES = {
    "second": ("m", "inertia", "k", "k2", "begins"),
    "thick second": ("m", "inertia", "k", "k2", "begins", "c"),
    "pad": ("m", "inertia", "k", "pad", "soft"),
    "thick pad": ("m", "inertia", "k", "pad", "soft", "c"),
}
PLAIN = ("m", "inertia", "k", "k3", "c")
"""Constants of a stiffening spring in oil, with which the next torques are planned."""
BOX = {
    "m": (0.02, 20.0),
    "inertia": (0.008, 30.0),
    "k": (0.08, 400.0),
    "c": (0.01, 80.0),
    "k2": (0.08, 2000.0),
    "begins": (0.2, 0.45),
    "k3": (0.08, 4000.0),
    "pad": (0.8, 10000.0),
    "soft": (0.1, 0.4),
}
REACHES = (0.62, 0.7, 0.75, 0.8, 0.84, 0.88, 0.9, 0.92, 0.94, 0.95, 0.96)
"""How far out the slider is let go in each iteration that has a model, in m; the last one goes on."""
INNERMOST_M, FAR_M, TIME_S, CALLS, ITERATIONS = 0.2, 0.84, 18.0, 148, 19
LEGS, AHEAD, LOOKS, TRIALS = 2, 5, 3, 200
TOUCHES, VISIBLE = (0.1, 1.0, 10.0), 0.05
"""First torques in N·m, each for 0.2 s, until the spin is seen, in rad/s."""


def _rates(structure, knobs, time, state, control):
    """Time derivative of place in the groove, speed along it and spin of the table."""
    s, v, spin = np.clip(state, -50.0, 50.0)
    u = s - REST_M
    pull = knobs["k"] * u + knobs.get("c", 0.0) * v + knobs.get("k3", 0.0) * u**3
    if "pad" in knobs:
        pull = pull + knobs["pad"] * np.maximum(u - knobs["soft"], 0.0) ** 2
    if "k2" in knobs:
        pull = pull + knobs["k2"] * np.maximum(u - knobs["begins"], 0.0)
    inertia = knobs["inertia"] + knobs["m"] * s**2
    return np.array([v, s * spin**2 - pull / knobs["m"], (control[0] - 2 * knobs["m"] * s * v * spin) / inertia])


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(REST_M, 0.0, 0.0),
    sigma=(0.0013, 0.0043, 0.0085),
    longest_s=0.09,
    starts=150,
    tried=3,
    rounds=8,
)


def _course(readings):
    """Torques, and what was read in the groove: place, speed and spin; without what is beyond the latch."""
    seen = [*(position("object_2", axis) for axis in (0, 1)), *(velocity("object_2", axis) for axis in (0, 1))]
    raw = recorded(readings, [Channel("apply_torque", "object_1", "torque_vector", 2)], seen)
    x, y, vx, vy = raw.readings.T
    s = np.hypot(x, y)
    groove = np.column_stack([s, (x * vx + y * vy) / s, (x * vy - y * vx) / s**2])
    lost = np.nonzero(s > LATCH_M - 0.005)[0]
    kept = int(lost[0]) if len(lost) else len(s)
    return Course(raw.durations[:kept], raw.controls[:kept], groove[:kept])


def _roughly(course, unit):
    """Constants of a stiffening spring from one leg after the other, from a point of the unit cube or anywhere."""
    names = PLAIN
    starts = np.vstack([LAWS.start, course.readings[:-1]]).T[:, :, None]

    def misfits(units):
        states, held = starts + np.zeros(units.shape[1]), course.controls.T[:, :, None]
        ends = LAWS.advanced("plain", _constants(units), 0.0, states, course.durations[:, None], held)
        off = (ends.transpose(1, 0, 2) - course.readings[:, :, None]) / (2 * np.array(LAWS.sigma)[:, None])
        return np.vstack([np.clip(np.nan_to_num(off, nan=1e4), -1e4, 1e4).reshape(-1, units.shape[1]), units - 0.5])

    if unit is None:
        units = np.random.default_rng(1).random((len(names), 400))
        unit = units[:, np.argmin(np.log1p(misfits(units) ** 2).sum(axis=0))]
        unit = refined(misfits, unit, 12)
    return refined(misfits, unit, 6)


def _constants(unit):
    """Constants of a stiffening spring at points of the unit cube."""
    return {name: BOX[name][0] * (BOX[name][1] / BOX[name][0]) ** part for name, part in zip(PLAIN, unit, strict=True)}


def _planned(knobs, state, span, reach):
    """Torques for the next legs: of many at random, those that carry the slider far, but not beyond the reach."""
    rng = np.random.default_rng(2)
    inertia = knobs["inertia"] + knobs["m"] * REST_M**2
    torques = min(TORQUE, inertia * knobs["k"] / knobs["m"]) * rng.choice(
        [-1.0, -0.5, -0.2, 0.0, 0.2, 0.5, 1.0], (AHEAD, TRIALS)
    )
    torques[:, 0] = 0.0
    states = np.array(state)[:, None] + np.zeros(TRIALS)
    far, value = states[0], np.zeros(TRIALS)
    for torque in torques:
        for _ in range(LOOKS):
            states = LAWS.advanced("plain", knobs, 0.0, states, span / LOOKS, torque[None, :])
            s = np.nan_to_num(states[0], nan=9.0)
            value -= 1e3 * (np.maximum(s - reach, 0.0) + np.maximum(INNERMOST_M - s, 0.0))
            far = np.maximum(far, s)
            value += 3 * np.maximum(np.minimum(s, reach) - FAR_M, 0.0)
    value += np.minimum(far, reach)
    return torques[:LEGS, int(np.argmax(value))]


def _turn(torque, duration):
    return [
        call("apply_torque", object_id="object_1", torque_vector=[0, 0, round(float(torque), 4)]),
        call("step", duration=max(round(duration / 0.005), 1) * 0.005),
        call("get_position", object_id="object_2"),
        call("get_velocity", object_id="object_2"),
    ]


def solve(task):
    """A touch, a spin of 1.2 rad/s, then torques that the model so far chooses."""
    seen, impulse, spin = [], 0.0, 0.0
    for torque in TOUCHES:
        calls = _turn(torque, 0.2)
        seen += zip(calls, (yield calls), strict=True)
        impulse, spin = impulse + 0.2 * torque, float(_course(seen).readings[-1, 2])
        if spin > VISIBLE:
            break
    torque = min(TORQUE, impulse * max(1.2 / spin - 1, 0.0) / 0.3)
    calls = [*_turn(torque, 0.3), *_turn(0.0, 0.2), *_turn(0.0, 0.2), *_turn(0.0, 0.2)]
    seen += zip(calls, (yield calls), strict=True)
    unit, reaches, spent = None, list(REACHES), 1.5
    for _ in range(ITERATIONS - 4):
        course = _course(seen)
        unit = _roughly(course, unit)
        knobs = _constants(unit)
        span = float(np.clip(0.95 * np.sqrt(knobs["m"] / knobs["k"]), 0.1, 0.6))
        spent += LEGS * span
        if len(seen) + 4 * LEGS > CALLS or spent > TIME_S:
            break
        seen_m = float(course.readings[:, 0].max()) - REST_M
        reach, reaches = min(reaches[0], REST_M + 0.03 + 1.7 * seen_m), reaches[1:] or reaches
        calls = [asked for torque in _planned(knobs, course.readings[-1], span, reach) for asked in _turn(torque, span)]
        seen += zip(calls, (yield calls), strict=True)
    yield [answer(_predict(*LAWS.best(_course(seen))))]


def _predict(structure, knobs):
    """Where the slider comes to rest after the pin is pulled, and the spin there."""
    knobs = {name: float(knobs[name]) for name in STRUCTURES[structure]}

    def rates(time, state):
        return _rates(structure, knobs, time, state, [0.0])

    def rests(time, state):
        return state[1] if time > 0 else 1.0

    rests.terminal, rests.direction = True, -1
    end = solve_ivp(rates, (0, 30), [REST_M, 0.0, SPIN], events=rests, rtol=1e-8, atol=1e-9).y[:, -1]
    return [float(end[0]), float(end[2])]


def fit(readings, structure):
    """The answer by the force of a structure."""
    return _predict(structure, LAWS.fitted(_course(readings), structure)[1])


def structure(knobs):
    """What is in the groove."""
    return knobs["kind"]


def theory(knobs):
    """The flight by its equations of motion."""
    return _predict(knobs["kind"], knobs)


def naive(knobs):
    """The spring of small motions; the place where pull and centrifugal force balance, as the table slows down."""
    small = _predict("second", {**knobs, "k2": 0.0})
    m, inertia = knobs["m"], knobs["inertia"]
    start = inertia + m * REST_M**2

    def pull(s):
        u = s - REST_M
        return (
            knobs["k"] * u
            + knobs["k2"] * max(0.0, u - knobs["begins"])
            + knobs["pad"] * max(0.0, u - knobs["soft"]) ** 2
        )

    def spin(s):
        return SPIN * start / (inertia + m * s**2)

    rests = brentq(lambda s: pull(s) - m * s * spin(s) ** 2, REST_M, 50.0)
    return {"spring of small motions": small, "balance": [rests, spin(rests)]}


def stage(task):
    """Turn as hard as possible, and read the largest distance and the last spin."""
    calls = [asked for _ in range(6) for asked in _turn(TORQUE, 0.5)]
    readings = yield calls
    course = _course(list(zip(calls, readings, strict=True)))
    yield [answer([float(np.max(course.readings[:, 0], initial=REST_M)), SPIN])]


def batch(task):
    """Torques to and fro, stronger and stronger, and the same fit."""
    torques = (0.1, 0.0, 0.2, 0.0, 0.5, 0.0, 1.0, -0.5, 2.0, 0.0, 5.0, 0.0, -3.0, 10.0, 0.0)
    calls = [asked for torque in torques for asked in _turn(torque, 0.4)]
    readings = yield calls
    yield [answer(_predict(*LAWS.best(_course(list(zip(calls, readings, strict=True))))))]


def measure(engine, knobs):
    """The same flight in the engine, without the latch."""
    free = engine.changed({"body[latch].pos": (0.0, 0.0, 0.0), "key[start].qvel": (SPIN, 0.0)})
    path = []
    while len(path) < 3 or path[-1][0] >= path[-2][0]:
        free.step(1)
        place = free.pose("object_2").position
        path.append((float(np.hypot(*place[:2])), float(free.turn("object_1").spin)))
    return [path[-2][0], path[-2][1]]
