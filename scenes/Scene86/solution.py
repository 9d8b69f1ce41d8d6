"""Scene 86: weigh the glider with a weak push, drive it fast and slow between the nets, fit each gas and each law."""

from itertools import product

import numpy as np
from scipy.integrate import solve_ivp

from scenes.courses import PLAIN, Laws, Predictor, force, position, velocity
from scenes.family import members
from scenes.protocol import answer
from scenes.rigs import Rig

SHOT_M_S, WEIGHT_M_S2 = 30.0, 9.81
GREATEST_N, GREATEST_M_S2 = 20.0, 18.0
LOW_M, HIGH_M, ROOM_M = -0.6, 11.4, 11.0
NETS_M = (-1.0, 12.0)
HIGHEST_M = 10.0
"""Height that has to be seen once: a layer may end just below."""
LEVELS = (1.0, 1.0, 0.0, 1.0, 0.4, 0.0, 1.0, 1.0, 0.2)
LEGS, LOOKS, TOUCH_S, CALLS = 13, 3, 0.1, 150
EDGE_M = 0.4
"""Half the thickness of the layer's edge."""
GASES = {"exponential": ("h",), "layer": ("edge", "rest")}
DRAGS = {"linear": "a", "square": "q"}


def _rates(structure, knobs, time, state, push):
    """Time derivative of height and speed."""
    z, v = state
    law, gas = ("square", "uniform") if structure == PLAIN else structure.split(", ")
    density = 1.0
    if gas == "exponential":
        density = np.exp(-z / knobs["h"])
    elif gas == "layer":
        density = 1 - (1 - knobs["rest"]) * (0.5 + 0.5 * np.tanh((z - knobs["edge"]) / EDGE_M))
    drag = knobs["a"] if law == "linear" else knobs["q"] * abs(v)
    return np.array([v + 0 * push[0], push[0] / knobs["m"] - density * drag * v])


LAWS = Laws(
    rates=_rates,
    structures={f"{law}, {gas}": ("m", DRAGS[law], *GASES[gas]) for law, gas in product(DRAGS, GASES)},
    box={"m": (0.005, 6), "a": (0.1, 5), "q": (0.008, 0.6), "h": (3, 10), "edge": (3.0, 8.0), "rest": (0.1, 0.4)},
    start=(0.0, 0.0),
    sigma=(0.04, 0.08),
    longest_s=0.1,
    starts=200,
    tried=5,
    rounds=12,
    plain=("m", "q"),
)
RIG = Rig([force("object_1", 2)], [position("object_1", 2), velocity("object_1", 2)])


def _course(readings):
    """The course up to where a net caught the glider."""
    course = RIG.course(readings)
    low, high = NETS_M
    kept = course.until((course.readings[:, 0] < low) | (course.readings[:, 0] > high))
    return kept if kept.count else course


def predict(structure, knobs):
    """Greatest height, and speed when back, of the shot with full weight."""

    def rates(time, state):
        return _rates(structure, knobs, time, state, [-WEIGHT_M_S2 * knobs["m"]])

    def turns(time, state):
        return state[1]

    def lands(time, state):
        return state[0] + (time < 0.01)

    turns.terminal = lands.terminal = True
    exact = {"rtol": 1e-7, "atol": 1e-8, "max_step": 0.05}
    up = solve_ivp(rates, (0, 60), [0.0, SHOT_M_S], events=turns, **exact).y[:, -1]
    down = solve_ivp(rates, (0, 60), [up[0], 0.0], events=lands, **exact).y[:, -1]
    return [float(up[0]), float(-down[1])]


def structure(knobs):
    """How the resistance follows the speed, and how the gas lies."""
    return f"{knobs['law']}, {knobs['gas']}"


MODEL = Predictor(LAWS, _course, predict)
fit = MODEL.fit


def rivals(readings):
    """Each gas with each law, fitted."""
    return members(LAWS, _course(readings), predict)


def naive(knobs):
    """Gas everywhere as at the bottom; no gas; gas as at the bottom with the resistance at 5 m/s in proportion."""
    drag = DRAGS[knobs["law"]]
    other = {"m": knobs["m"], "a": 8.0 * knobs["q"], "q": knobs["a"] / 8.0}
    law = "square" if drag == "a" else "linear"
    return {
        "uniform gas": predict(f"{knobs['law']}, exponential", {**knobs, "h": 1e9}),
        "no gas": [SHOT_M_S**2 / (2 * WEIGHT_M_S2), SHOT_M_S],
        "other law": predict(f"{law}, {knobs['gas']}", {**knobs, **other}),
    }


def _safe(z, v, acceleration, duration, greatest):
    """Whether the glider stays off the nets during a leg, and can be stopped short of them after it."""
    end, speed = z + v * duration + acceleration * duration**2 / 2, v + acceleration * duration
    stop = end + speed * abs(speed) / (2 * 0.9 * greatest)
    return min(end, stop) > LOW_M and max(end, stop) < HIGH_M


def _chosen(z, v, levels, sense, greatest, duration):
    """Acceleration of a leg, and the sense of the motion from now on: rather gently onwards than back."""
    for turn, level in product((sense, -sense), levels):
        if _safe(z, v, turn * level * greatest, duration, greatest):
            return turn * level * greatest, turn
    return -np.sign(v) * greatest, -sense


def solve(task):
    """Pushes that grow until the glider moves visibly; then up and down, always short of the nets."""
    seen, strength = yield from RIG.touched(0.3, 4.0, TOUCH_S, lambda reading: reading[1] > 0.25)
    places, speeds = RIG.course(seen).readings.T
    (z, v), before = (places[-1], speeds[-1]), [0.0, *speeds][-2]
    mass, sense, highest = strength * TOUCH_S / max(v - before, 0.1), 1.0, z
    for leg in range(LEGS):
        greatest = min(0.95 * GREATEST_N / mass, GREATEST_M_S2)
        duration = round(0.65 * np.sqrt(ROOM_M / greatest), 2)
        levels = (LEVELS[leg % len(LEVELS)], *((0.4, 0.0) if highest < HIGHEST_M and sense > 0 else ()))
        acceleration, sense = _chosen(z, v, levels, sense, greatest, duration)
        calls = RIG.leg(acceleration * mass, duration, LOOKS)
        if len(seen) + len(calls) > CALLS:
            break
        seen += zip(calls, (yield calls), strict=True)
        course = RIG.course(seen)
        z, v = course.readings[-1]
        highest = max(highest, z)
        mass = LAWS.fitted(course, PLAIN)[1]["m"] if leg < 3 else mass
    yield [answer(MODEL.best(seen))]


PULSES = ((1, 0.3), (-2, 0.3), (4, 0.3), (-8, 0.3), (16, 0.3), (-8, 0.4), (8, 0.5), (-16, 0.4))


def batch(task):
    """Pushes up and down, ever stronger, and the same fit up to where a net caught."""
    calls = [asked for strength, duration in PULSES for asked in RIG.leg(strength, duration, 2)]
    readings = yield calls
    yield [answer(MODEL.best(list(zip(calls, readings, strict=True))))]


def stage(task):
    """Push as hard as one can, to shoot; the net catches the glider."""
    readings = yield [*RIG.leg(GREATEST_N, 1.0), *RIG.leg(0.0, 3.0)]
    yield [answer([readings[-2]["position"][2], abs(readings[-1]["velocity"][2])])]


def measure(engine, knobs):
    """The shot in the engine, with the weight as a push and the nets a million metres away."""
    free = engine.changed({"body[nets].pos": (0.0, 0.0, 1e6)})
    free.push("object_1", force=np.array([0.0, 0.0, -WEIGHT_M_S2 * knobs["m"]]))
    free.set_velocity("object_1", np.array([0.0, 0.0, SHOT_M_S]))
    top, z, v = 0.0, 0.0, SHOT_M_S
    while z >= 0.0:
        top, before = max(top, z), (z, v)
        free.step(1)
        z, v = float(free.pose("object_1").position[2]), float(free.twist("object_1").linear[2])
    share = before[0] / (before[0] - z)
    return [top, -(before[1] + share * (v - before[1]))]
