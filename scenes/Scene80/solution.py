"""Scene 80: swing the glider below the latch, fit spring, engine and loss, and integrate to the steady swing."""

import numpy as np
from scipy.integrate import solve_ivp

from scenes.courses import Laws, Predictor, force, position, velocity
from scenes.family import members
from scenes.protocol import answer
from scenes.rigs import Rig
from scenes.swings import LegFit, Swing, to_a_side

FORCE, LATCH_M = 8.0, 0.4
LOSSES = {"place": "a", "speed": "b", "drag": "d"}
STRUCTURES = {name: ("m", "w", "g", loss) for name, loss in LOSSES.items()}
BOX = {
    "m": (0.004, 10.0),
    "w": (2.0, 30.0),
    "g": (0.08, 2.5),
    "a": (0.1, 30.0),
    "b": (0.005, 5.0),
    "d": (0.01, 5.0),
}
"""Mass; stiffness, gain of the engine, and loss over it: with the square of the place, of the speed, with the speed."""
REACHES = (0.1, 0.18, 0.26, 0.31, 0.34, 0.36, 0.37)
"""How far the glider is let go in each round, in m; the last one goes on."""
FAR_M = 0.2


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
    sigma=(0.00072, 0.00143),
    longest_s=0.05,
    starts=120,
    tried=3,
    rounds=10,
    plain=("m", "w", "g"),
)
"""The plain law lacks the loss."""
RIG = Rig([force("object_1", 0)], [position("object_1", 0), velocity("object_1", 0)], decimals=6)


def _course(readings):
    """The course up to where the latch caught."""
    course = RIG.course(readings)
    return course.until(abs(course.readings[:, 0]) > LATCH_M - 0.005)


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


def predict(structure, knobs):
    """Greatest distance, and greatest speed with twice the mass."""
    knobs = {name: float(knobs[name]) for name in STRUCTURES[structure]}
    heavy = {name: value if name == "m" else value / 2 for name, value in knobs.items()}
    return [_swing(structure, knobs)[0], _swing(structure, heavy)[1]]


SWING = Swing(
    rig=RIG,
    model=Predictor(LAWS, _course, predict),
    rough=LegFit(LAWS),
    touches=(0.005, 0.02, 0.08, 0.32, 1.28, 5.0, 8.0),
    touch_s=0.15,
    moved=lambda reading: abs(reading[1]) > 0.03,
    strongest=lambda plan: min(FORCE, 1.2 * plan.reach * plan.knobs["w"] * plan.knobs["m"]),
    worth=lambda plan, path: to_a_side(plan, path[:, 0], FAR_M, 3 * abs(path[:, 1]) / plan.knobs["w"] ** 0.5),
    span=lambda knobs: float(np.clip(0.9 / np.sqrt(knobs["w"]), 0.08, 0.5)),
    reaches=REACHES,
    wider=lambda course: 0.04 + 1.8 * float(abs(course.readings[:, 0]).max()),
    time_s=13.1,
    fixed_pushes=(0.005, 0.0, -0.015, 0.0, 0.05, 0.0, -0.15, 0.0, 0.5, 0.0, -1.5, 0.0, 4.0, 0.0, -8.0),
    fixed_s=0.4,
)
solve, batch, fit = SWING.solve, SWING.batch, SWING.model.fit


def rivals(readings):
    """Each loss, fitted to the course."""
    return members(LAWS, _course(readings), predict)


def naive(knobs):
    """A swing at the latch; another loss, alike in swings of 0.36 m."""
    turn, kind, far = knobs["w"] ** 0.5, knobs["kind"], REACHES[-1]
    loss = {
        "place": knobs["a"] * far**2 / 4,
        "speed": 0.75 * knobs["b"] * knobs["w"] * far**2,
        "drag": 8 / (3 * np.pi) * knobs["d"] * turn * far,
    }[kind]
    if kind == "place":
        other = predict("speed", {**knobs, "b": loss / (0.75 * knobs["w"] * far**2)})
    else:
        other = predict("place", {**knobs, "a": 4 * loss / far**2})
    return {"another loss": other, "at the latch": [LATCH_M, LATCH_M * turn]}


def stage(task):
    """Push, and let it swing up; the latch catches it."""
    readings = yield [*RIG.leg(FORCE, 0.3), *RIG.leg(0.0, 8.0, 20)]
    places = [abs(reading["position"][0]) for reading in readings if "position" in reading]
    speeds = [abs(reading["velocity"][0]) for reading in readings if "velocity" in reading]
    yield [answer([max(places), max(speeds) / 2**0.5])]


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
