"""Scene 77: spin the table gently, swing the slider wider and wider below the latch, fit, and pull the pin."""

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from scenes.courses import Channel, Course, Laws, Predictor, position, velocity
from scenes.family import members
from scenes.protocol import answer
from scenes.rigs import Rig
from scenes.swings import LegFit, Swing, to_and_fro

REST_M, LATCH_M, TORQUE, SPIN = 0.5, 1.0, 10.0, 7.0
STRUCTURES = {
    "second": ("m", "inertia", "k", "k2", "begins"),
    "thick second": ("m", "inertia", "k", "k2", "begins", "c"),
    "pad": ("m", "inertia", "k", "pad", "soft"),
    "thick pad": ("m", "inertia", "k", "pad", "soft", "c"),
}
BOX = {
    "m": (0.02, 20.0),
    "inertia": (0.008, 30.0),
    "k": (0.08, 400.0),
    "c": (0.01, 80.0),
    "k2": (0.08, 2000.0),
    "begins": (0.2, 0.4),
    "k3": (0.08, 4000.0),
    "pad": (0.8, 10000.0),
    "soft": (0.2, 0.4),
}
INNERMOST_M, FAR_M = 0.2, 0.84


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
    plain=("m", "inertia", "k", "k3", "c"),
)
"""The plain law is a stiffening spring in oil."""
RIG = Rig(
    [Channel("apply_torque", "object_1", "torque_vector", 2)],
    [position("object_2", 0), position("object_2", 1), velocity("object_2", 0), velocity("object_2", 1)],
)


def _course(readings):
    """Torques, and what was read in the groove: place, speed and spin; up to where the latch caught."""
    raw = RIG.course(readings)
    x, y, vx, vy = raw.readings.T
    s = np.hypot(x, y)
    groove = np.column_stack([s, (x * vx + y * vy) / s, (x * vy - y * vx) / s**2])
    return Course(raw.durations, raw.controls, groove).until(s > LATCH_M - 0.005)


def _spun(course):
    """A torque that makes the spin 1.2 rad/s, then none."""
    impulse, spin = float(course.durations @ course.controls[:, 0]), float(course.readings[-1, 2])
    torque = min(TORQUE, impulse * max(1.2 / spin - 1, 0.0) / 0.3)
    return (torque, 0.3), (0.0, 0.2), (0.0, 0.2), (0.0, 0.2)


def _pattern(rng, legs, trials):
    """Torques to and fro, and none at all."""
    shares = to_and_fro(rng, legs, trials)
    shares[:, :, 0] = 0.0
    return shares


def _worth(plan, path):
    """Goes far out, within the reach and not too near the axle."""
    s = path[:, 0]
    beyond = np.maximum(s - plan.reach, 0.0) + np.maximum(INNERMOST_M - s, 0.0)
    wide = np.maximum(np.minimum(s, plan.reach) - FAR_M, 0.0)
    return (3 * wide - 1e3 * beyond).sum(axis=0) + np.minimum(s.max(axis=0), plan.reach)


def predict(structure, knobs):
    """Where the slider comes to rest after the pin is pulled, and the spin there."""
    knobs = {name: float(knobs[name]) for name in STRUCTURES[structure]}

    def rates(time, state):
        return _rates(structure, knobs, time, state, [0.0])

    def rests(time, state):
        return state[1] if time > 0 else 1.0

    rests.terminal, rests.direction = True, -1
    end = solve_ivp(rates, (0, 30), [REST_M, 0.0, SPIN], events=rests, rtol=1e-8, atol=1e-9).y[:, -1]
    return [float(end[0]), float(end[2])]


SWING = Swing(
    rig=RIG,
    model=Predictor(LAWS, _course, predict),
    rough=LegFit(LAWS),
    touches=(0.1, 1.0, 10.0),
    moved=lambda reading: reading[2] > 0.05,
    settled=_spun,
    strongest=lambda plan: min(TORQUE, (plan.knobs["inertia"] / plan.knobs["m"] + REST_M**2) * plan.knobs["k"]),
    pattern=_pattern,
    worth=_worth,
    span=lambda knobs: float(np.clip(0.95 * np.sqrt(knobs["m"] / knobs["k"]), 0.1, 0.6)),
    reaches=(0.62, 0.7, 0.75, 0.8, 0.84, 0.88, 0.9, 0.92, 0.94, 0.95, 0.96),
    wider=lambda course: REST_M + 0.03 + 1.7 * (float(course.readings[:, 0].max()) - REST_M),
    rounds=15,
    legs=2,
    trials=200,
    time_s=16.5,
    fixed_pushes=(0.1, 0.0, 0.2, 0.0, 0.5, 0.0, 1.0, -0.5, 2.0, 0.0, 5.0, 0.0, -3.0, 10.0, 0.0),
    fixed_s=0.4,
)
solve, batch, fit = SWING.solve, SWING.batch, SWING.model.fit


def rivals(readings):
    """Each force further out, with and without oil, fitted to the course."""
    return members(LAWS, _course(readings), predict)


def naive(knobs):
    """The spring of small motions; the place where pull and centrifugal force balance, as the table slows down."""
    small = predict("second", {**knobs, "k2": 0.0})
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
    calls = RIG.leg(TORQUE, 3.0, 6)
    readings = yield calls
    course = _course(list(zip(calls, readings, strict=True)))
    yield [answer([float(np.max(course.readings[:, 0], initial=REST_M)), SPIN])]


def measure(engine, knobs):
    """The same flight in the engine, without the latch."""
    free = engine.changed({"body[latch].pos": (0.0, 0.0, 0.0), "key[start].qvel": (SPIN, 0.0)})
    path = []
    while len(path) < 3 or path[-1][0] >= path[-2][0]:
        free.step(1)
        place = free.pose("object_2").position
        path.append((float(np.hypot(*place[:2])), float(free.turn("object_1").spin)))
    return [path[-2][0], path[-2][1]]
