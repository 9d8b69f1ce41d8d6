"""Scene 80: swing the glider below the latch, fit spring, engine and loss, and integrate to the steady swing."""

import numpy as np
from scipy.integrate import solve_ivp

from scenes.courses import Course, Laws, force, position, recorded, refined, velocity
from scenes.protocol import answer, call

FORCE, LATCH_M = 8.0, 0.4
LOSSES = {"place": "a", "speed": "b", "drag": "d"}
STRUCTURES = {name: ("m", "w", "g", loss) for name, loss in LOSSES.items()}
PLAIN = ("m", "w", "g")
"""Constants without loss, with which the next forces are planned."""
BOX = {
    "m": (0.004, 10.0),
    "w": (2.0, 30.0),
    "g": (0.08, 2.5),
    "a": (0.1, 30.0),
    "b": (0.005, 5.0),
    "d": (0.01, 5.0),
}
"""Mass; stiffness, gain of the engine, and loss over it: with the square of the place, of the speed, with the speed."""
REACHES = (0.08, 0.14, 0.2, 0.26, 0.3, 0.33, 0.35, 0.36)
"""How far the glider is let go in each iteration that has a model, in m; the last one goes on."""
FAR_M, TIME_S, CALLS, ITERATIONS = 0.2, 14.3, 148, 19
LEGS, AHEAD, LOOKS, TRIALS = 3, 5, 3, 300
TOUCHES, VISIBLE, TOUCH_S = (0.005, 0.02, 0.08, 0.32, 1.28, 5.0, 8.0), 0.03, 0.15
"""First forces in N until the speed is seen, in m/s."""


def _rates(structure, knobs, time, state, control):
    """Time derivative of place and speed."""
    x, v = np.clip(state, -50.0, 50.0)
    gain = knobs["g"]
    if "a" in knobs:
        gain = gain - knobs["a"] * x**2
    if "b" in knobs:
        gain = gain - knobs["b"] * v**2
    if "d" in knobs:
        gain = gain - knobs["d"] * abs(v)
    return np.array([v, control[0] / knobs["m"] - knobs["w"] * x + gain * v])


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(0.0, 0.0),
    sigma=(0.0011, 0.0021),
    longest_s=0.05,
    starts=120,
    tried=3,
    rounds=10,
)


def _course(readings):
    """Forces, places and speeds, up to where the latch caught."""
    raw = recorded(readings, [force("object_1", 0)], [position("object_1", 0), velocity("object_1", 0)])
    lost = np.nonzero(abs(raw.readings[:, 0]) > LATCH_M - 0.005)[0]
    kept = int(lost[0]) if len(lost) else len(raw.durations)
    return Course(raw.durations[:kept], raw.controls[:kept], raw.readings[:kept])


def _constants(unit):
    """Constants without loss at points of the unit cube."""
    return {name: BOX[name][0] * (BOX[name][1] / BOX[name][0]) ** part for name, part in zip(PLAIN, unit, strict=True)}


def _roughly(course, unit):
    """The constants from one leg after the other, from a point of the unit cube or anywhere."""
    starts = np.vstack([LAWS.start, course.readings[:-1]]).T[:, :, None]

    def misfits(units):
        states, held = starts + np.zeros(units.shape[1]), course.controls.T[:, :, None]
        ends = LAWS.advanced("plain", _constants(units), 0.0, states, course.durations[:, None], held)
        off = (ends.transpose(1, 0, 2) - course.readings[:, :, None]) / (2 * np.array(LAWS.sigma)[:, None])
        return np.vstack([np.clip(np.nan_to_num(off, nan=1e4), -1e4, 1e4).reshape(-1, units.shape[1]), units - 0.5])

    if unit is None:
        units = np.random.default_rng(1).random((len(PLAIN), 400))
        unit = units[:, np.argmin(np.log1p(misfits(units) ** 2).sum(axis=0))]
        unit = refined(misfits, unit, 12)
    return refined(misfits, unit, 6)


def _planned(knobs, state, span, reach, side):
    """Forces for the next legs: of many at random, those that carry the glider to a side, within the reach."""
    rng = np.random.default_rng(2)
    strongest = min(FORCE, 1.2 * reach * knobs["w"] * knobs["m"])
    forces = strongest * rng.choice([-1.0, -0.5, -0.2, 0.0, 0.2, 0.5, 1.0], (AHEAD, TRIALS))
    states, value = np.array(state)[:, None] + np.zeros(TRIALS), np.zeros(TRIALS)
    for held in forces:
        for _ in range(LOOKS):
            states = LAWS.advanced("plain", knobs, 0.0, states, span / LOOKS, held[None, :])
            place = np.nan_to_num(abs(states[0]), nan=9.0)
            value += (
                10 * np.maximum(np.minimum(side * states[0], reach) - FAR_M, 0.0)
                + 3 * abs(states[1]) / knobs["w"] ** 0.5
            )
            value -= 1e3 * np.maximum(place - reach, 0.0)
    return forces[:LEGS, int(np.argmax(value))]


def _push(strength, duration):
    return [
        call("apply_force", object_id="object_1", force_vector=[round(float(strength), 6), 0, 0]),
        call("step", duration=max(round(duration / 0.005), 1) * 0.005),
        call("get_position", object_id="object_1"),
        call("get_velocity", object_id="object_1"),
    ]


def solve(task):
    """Touches until the glider moves, then forces that the model so far chooses."""
    seen = []
    for strength in TOUCHES:
        calls = _push(strength, TOUCH_S)
        seen += zip(calls, (yield calls), strict=True)
        if abs(_course(seen).readings[-1, 1]) > VISIBLE:
            break
    calls = [*_push(0.0, 0.2), *_push(0.0, 0.2)]
    seen += zip(calls, (yield calls), strict=True)
    unit, reaches, spent = None, list(REACHES), 1.2
    for number in range(ITERATIONS - 5):
        course = _course(seen)
        unit = _roughly(course, unit)
        knobs = _constants(unit)
        span = float(np.clip(0.9 / np.sqrt(knobs["w"]), 0.08, 0.5))
        spent += LEGS * span
        if len(seen) + 4 * LEGS > CALLS or spent > TIME_S:
            break
        wide = float(abs(course.readings[:, 0]).max())
        reach, reaches = min(reaches[0], 0.04 + 1.8 * wide), reaches[1:] or reaches
        planned = _planned(knobs, course.readings[-1], span, reach, (-1) ** (number // 2))
        calls = [asked for strength in planned for asked in _push(strength, span)]
        seen += zip(calls, (yield calls), strict=True)
    yield [answer(_predict(*LAWS.best(_course(seen))))]


def _wide(structure, knobs):
    """Amplitude of the steady swing, to first order in the gain."""
    turn = knobs["w"] ** 0.5
    if structure == "place":
        return 2 * (knobs["g"] / knobs["a"]) ** 0.5
    if structure == "speed":
        return (4 * knobs["g"] / (3 * knobs["b"])) ** 0.5 / turn
    return 3 * np.pi * knobs["g"] / (8 * knobs["d"] * turn)


def _swing(structure, knobs):
    """Greatest distance and greatest speed of the steady swing."""

    def rates(time, state):
        return _rates(structure, knobs, time, state, [0.0])

    period = 2 * np.pi / knobs["w"] ** 0.5
    count = int(np.clip(np.ceil(10 / knobs["g"] / period), 2, 60))
    start = [min(_wide(structure, knobs), 30.0), 0.0]
    course = solve_ivp(rates, (0, count * period), start, rtol=1e-8, atol=1e-9, dense_output=True)
    last = course.sol(np.linspace((count - 1.3) * period, count * period, 3000))
    return float(abs(last[0]).max()), float(abs(last[1]).max())


def _predict(structure, knobs):
    """Greatest distance, and greatest speed with twice the mass."""
    knobs = {name: float(knobs[name]) for name in STRUCTURES[structure]}
    heavy = {name: value if name == "m" else value / 2 for name, value in knobs.items()}
    return [_swing(structure, knobs)[0], _swing(structure, heavy)[1]]


def fit(readings, structure):
    """The answer by the loss of a structure."""
    return _predict(structure, LAWS.fitted(_course(readings), structure)[1])


def structure(knobs):
    """On what the loss depends."""
    return knobs["kind"]


def theory(knobs):
    """The steady swings by their equation of motion."""
    return _predict(knobs["kind"], knobs)


def naive(knobs):
    """A swing at the latch; another loss, alike in swings of 0.36 m."""
    turn, kind, far = knobs["w"] ** 0.5, knobs["kind"], REACHES[-1]
    loss = {
        "place": knobs["a"] * far**2 / 4,
        "speed": 0.75 * knobs["b"] * knobs["w"] * far**2,
        "drag": 8 / (3 * np.pi) * knobs["d"] * turn * far,
    }[kind]
    if kind == "place":
        other = _predict("speed", {**knobs, "b": loss / (0.75 * knobs["w"] * far**2)})
    else:
        other = _predict("place", {**knobs, "a": 4 * loss / far**2})
    return {"another loss": other, "at the latch": [LATCH_M, LATCH_M * turn]}


def stage(task):
    """Push, and let it swing up; the latch catches it."""
    readings = yield [*_push(FORCE, 0.3), *[asked for _ in range(20) for asked in _push(0.0, 0.4)]]
    places = [abs(reading["position"][0]) for reading in readings if "position" in reading]
    speeds = [abs(reading["velocity"][0]) for reading in readings if "velocity" in reading]
    yield [answer([max(places), max(speeds) / 2**0.5])]


def batch(task):
    """Pushes to and fro, stronger and stronger, and the same fit."""
    forces = (0.005, 0.0, -0.015, 0.0, 0.05, 0.0, -0.15, 0.0, 0.5, 0.0, -1.5, 0.0, 4.0, 0.0, -8.0)
    calls = [asked for strength in forces for asked in _push(strength, 0.4)]
    readings = yield calls
    yield [answer(_predict(*LAWS.best(_course(list(zip(calls, readings, strict=True))))))]


def measure(engine, knobs):
    """The steady swings in the engine, without the latch; begun near them."""
    found = []
    for times in (1, 2):
        scaled = {name: knobs[name] / times for name in ("w", "g", "a", "b", "d")}
        changes = {
            "body[latch].pos": (0.0, 0.0, 0.0),
            "body[object_1]/inertial.mass": times * knobs["m"],
            "key[start].qpos": (_wide(knobs["kind"], scaled),),
        }
        free = engine.changed(changes)
        far = fast = 0.0
        settled, period = 8 / scaled["g"], 2 * np.pi / scaled["w"] ** 0.5
        free.step(free.whole_steps(settled))
        for _ in range(free.whole_steps(1.1 * period)):
            free.step(1)
            far = max(far, abs(float(free.pose("object_1").position[0])))
            fast = max(fast, abs(float(free.twist("object_1").linear[0])))
        found.append(far if times == 1 else fast)
    return found
