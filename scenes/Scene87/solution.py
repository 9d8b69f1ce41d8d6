"""Scene 87: lead the diver up and down between the nets, fit gas, water and drag, and follow it into the deep."""

import numpy as np
from scipy.integrate import solve_ivp

from scenes.courses import Laws, Predictor, force, position, velocity
from scenes.family import member
from scenes.fitting import polished
from scenes.protocol import answer
from scenes.rigs import Rig
from scenes.swings import LegFit, Swing, to_a_side

FORCE, NET_M, DEEP_M, START_M_S, PASSED_M = 10.0, 1.0, 3.0, 5.0, 3.0
STRUCTURES = {
    "fresh, slow": ("m", "g", "h", "c"),
    "fresh, fast": ("m", "g", "h", "q"),
    "salt, fast": ("m", "g", "h", "s", "q"),
    "salt, slow": ("m", "g", "h", "s", "c"),
}
BOX = {
    "m": (0.003, 5.0),
    "g": (0.8, 15.0),
    "h": (1.2, 5.0),
    "s": (0.0, 1.0),
    "q": (0.05, 5.0),
    "c": (0.05, 5.0),
}
"""Mass; over it, weight less buoyancy far below; depth at which the gas has half its volume; growth of the buoyancy
with depth; drag with the square of the speed, or with the speed."""
FAR_M = 0.5


def _rates(structure, knobs, time, state, control):
    """Time derivative of height and speed upwards."""
    z, v = np.clip(state, -50.0, 50.0)
    sinks = -knobs["g"] * z / np.maximum(knobs["h"] - z, 0.05)
    salt = -knobs["s"] * z if "s" in knobs else 0.0
    drag = knobs.get("q", 0.0) * abs(v) + knobs.get("c", 0.0)
    return np.array([v, control[0] / knobs["m"] - sinks + salt - drag * v])


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(0.0, 0.0),
    sigma=(0.00013, 0.00025),
    longest_s=0.1,
    starts=120,
    tried=3,
    rounds=10,
    plain=("m", "g", "h", "q", "c"),
)
"""The plain law has both drags and no salt."""
LEGS = LegFit(LAWS, spread=1.6, pull=0.3, tried=2, rounds=15, again=8)
"""The diver leaves every height by itself, so that a course as a whole depends on its start far too much."""
RIG = Rig([force("object_1", 2)], [position("object_1", 2), velocity("object_1", 2)], decimals=6)


def _course(readings):
    """The course up to where a net caught."""
    course = RIG.course(readings)
    return course.until(abs(course.readings[:, 0]) > NET_M - 0.005)


def predict(structure, knobs):
    """Force that holds the diver in the deep, and its speed after a start downwards."""
    knobs = {name: float(knobs[name]) for name in STRUCTURES[structure]}
    holds = -knobs["m"] * float(_rates(structure, knobs, 0.0, np.array([-DEEP_M, 0.0]), [0.0])[1])

    def rates(time, state):
        return _rates(structure, knobs, time, state, [0.0])

    def passes(time, state):
        return state[0] + PASSED_M

    def turns(time, state):
        return state[1]

    passes.terminal = turns.terminal = True
    end = solve_ivp(rates, (0, 60), [0.0, -START_M_S], events=[passes, turns], rtol=1e-8, atol=1e-9).y[:, -1]
    return [holds, -float(end[1])]


SWING = Swing(
    rig=RIG,
    model=Predictor(LEGS, _course, predict),
    rough=LEGS,
    touches=(0.005, 0.02, 0.08, 0.32, 1.28, 5.0, 10.0),
    touch_s=0.15,
    moved=lambda reading: abs(reading[1]) > 0.03,
    strongest=lambda plan: min(FORCE, (2.0 * plan.knobs["g"] / plan.knobs["h"] + 3.0) * plan.reach * plan.knobs["m"]),
    worth=lambda plan, path: to_a_side(plan, path[:, 0], FAR_M, abs(path[:, 0])),
    span=lambda knobs: float(np.clip(0.7 / np.sqrt(knobs["g"] / knobs["h"]), 0.2, 0.5)),
    reaches=(0.3, 0.6, 0.8, 0.88, 0.92),
    wider=lambda course: 0.08 + 2.2 * float(abs(course.readings[:, 0]).max()),
    turns_every=1,
    time_s=16.8,
    fixed_pushes=(0.005, -0.01, 0.0, 0.02, -0.05, 0.0, 0.1, -0.2, 0.0, 0.5, -1.0, 0.0, 3.0, -6.0, 10.0),
    fixed_s=0.5,
)
solve, batch, fit = SWING.solve, SWING.batch, SWING.model.fit


def _member(course, structure):
    """Water and drag of a structure, fitted to each leg from the readings before it."""

    def misfits(units):
        found = LAWS.misfits(course, structure, units, by_legs=True, spread=LEGS.spread, pull=0.0)
        return found[: course.count]

    best = polished(misfits, LEGS.unit(course, structure))
    return member(
        lambda unit: misfits(unit[:, None])[:, 0],
        lambda unit: predict(structure, LAWS.constants(structure, unit)),
        best,
        [(0.0, 1.0)] * len(best),
    )


def rivals(readings):
    """Each water and drag, fitted."""
    course = _course(readings)
    return {structure: _member(course, structure) for structure in STRUCTURES}


def naive(knobs):
    """Forces in proportion to the depth; the diver of no gas left, in fresh water."""
    stiff = knobs["g"] / knobs["h"] - (knobs["s"] if "salt" in knobs["kind"] else 0.0)
    line = {**knobs, "g": 1e4 * stiff, "h": 1e4, "s": 0.0}
    return {"in proportion": predict(knobs["kind"], line), "no gas left": [knobs["m"] * knobs["g"], START_M_S]}


def stage(task):
    """Push it down; the net catches it."""
    readings = yield [*RIG.leg(-FORCE, 0.5), *RIG.leg(-FORCE, 0.5), *RIG.leg(-FORCE, 2.0)]
    yield [answer([FORCE, max(abs(reading["velocity"][2]) for reading in readings[3::4]) + 0.001])]


def measure(engine, knobs):
    """Without nets: the change of speed in a step from rest in the deep; the start downwards."""
    free = engine.changed({"body[net].pos": (0.0, 0.0, 0.0), "key[start].qpos": (-DEEP_M,)})
    free.step(1)
    holds = -knobs["m"] * float(free.twist("object_1").linear[2]) * free.whole_steps(1.0)
    free = engine.changed({"body[net].pos": (0.0, 0.0, 0.0), "key[start].qvel": (-START_M_S,)})
    path = [(0.0, START_M_S)]
    while path[-1][0] < PASSED_M and path[-1][1] > 0:
        free.step(1)
        path.append((-float(free.pose("object_1").position[2]), -float(free.twist("object_1").linear[2])))
    return [holds, path[-1][1]]
