"""Scene 88: swing the puck out to near the rim, fit each rule of the cord to the course, predict."""

from itertools import product

import numpy as np
from scipy.integrate import solve_ivp

from scenes.courses import Laws, Predictor, force, position, velocity
from scenes.family import members
from scenes.protocol import answer
from scenes.rigs import Rig

RADIUS_M, SHOT_M_S, RIM_M = 2.5, 10.0, 1.5
GREATEST_N, GREATEST_M_S2 = 7.9, 14.0
NEAR_M = 1.3
LEGS, LEG_S, FREE_S, LOOKS, CALLS = 13, 0.78, 0.8, 3, 150
STRUCTURES = {"softening": ("m", "k", "d", "s"), "stiffening": ("m", "k", "d", "b"), "slack": ("m", "k", "d", "l")}


def _pull(structure, knobs, r):
    """Pull of the cord over the mass."""
    if structure == "slack":
        return knobs["k"] * np.maximum(r - knobs["l"], 0.0)
    if structure == "softening":
        return knobs["k"] * r / (1 + r / knobs["s"])
    return knobs["k"] * r + (knobs["b"] * r**3 if structure == "stiffening" else 0.0)


def _rates(structure, knobs, time, state, push):
    """Time derivative of place and velocity."""
    x, y, vx, vy = state
    r = np.sqrt(x**2 + y**2 + 1e-12)
    inward = _pull(structure, knobs, np.minimum(r, knobs.get("far", r))) / r
    return np.array(
        [
            vx,
            vy,
            push[0] / knobs["m"] - inward * x - knobs["d"] * vx,
            push[1] / knobs["m"] - inward * y - knobs["d"] * vy,
        ]
    )


def _laws(starts, tried, rounds):
    return Laws(
        rates=_rates,
        structures=STRUCTURES,
        box={"m": (0.001, 2), "k": (2, 60), "d": (0.03, 2), "b": (0.3, 15), "l": (0.1, 1.2), "s": (0.5, 10)},
        start=(0.0, 0.0, 0.0, 0.0),
        sigma=(0.02, 0.02, 0.055, 0.055),
        longest_s=0.1,
        starts=starts,
        tried=tried,
        rounds=rounds,
    )


LAWS, QUICK = _laws(80, 3, 12), _laws(60, 1, 8)
RIG = Rig(
    [force("object_1", axis) for axis in (0, 1)],
    [of("object_1", axis) for of in (position, velocity) for axis in (0, 1)],
    decimals=6,
)


def _course(readings):
    """The course up to where the rim caught the puck."""
    course = RIG.course(readings)
    return course.until(np.hypot(*course.readings[:, :2].T) > RIM_M)


def predict(structure, knobs):
    """Speed and pull on the circle, and the greatest distance of the shot."""
    pull = float(_pull(structure, knobs, RADIUS_M))

    def rates(time, state):
        return [state[1], -knobs["d"] * state[1] - _pull(structure, knobs, state[0])]

    def turns(time, state):
        return state[1]

    turns.terminal = True
    shot = solve_ivp(rates, (0, 30), [0.0, SHOT_M_S], events=turns, rtol=1e-8, atol=1e-9, max_step=0.02)
    return [(pull * RADIUS_M) ** 0.5, knobs["m"] * pull, float(shot.y[0, -1])]


MODEL = Predictor(LAWS, _course, predict)
fit = MODEL.fit


def rivals(readings):
    """Each rule of the cord, fitted."""
    return members(LAWS, _course(readings), predict)


def naive(knobs):
    """A spring that pulls alike at 1.2 m; a spring that pulls alike at 0.9 m, without air."""
    far, middle = (float(_pull(knobs["kind"], knobs, r)) / r for r in (1.2, 0.9))
    return {
        "in proportion": predict("slack", {**knobs, "k": far, "l": 0.0}),
        "in proportion, no air": predict("slack", {**knobs, "k": middle, "d": 0.0, "l": 0.0}),
    }


def _reached(structure, knobs, course):
    """Place and velocity at the end of a course."""
    state = np.zeros((4, 1))
    for duration, control in zip(course.durations, course.controls, strict=True):
        state = LAWS.advanced(structure, knobs, 0.0, state, duration, control[:, None])
    return state


def _chosen(fits, course, widest, wanted):
    """Push of a leg that carries the puck this far, and no farther by any rule of the cord, neither let go nor stopped.

    Whether it can be stopped is asked as if the cord pulled no more farther out than where the puck has been.
    """
    greatest = min(GREATEST_N, GREATEST_M_S2 * min(knobs["m"] for knobs in fits.values()))
    angles, shares = (
        part.ravel() for part in np.meshgrid(np.arange(12) * np.pi / 6, (0.0, 0.04, 0.1, 0.2, 0.4, 0.7, 1.0))
    )
    pushes = greatest * shares * np.array([np.cos(angles), np.sin(angles)])
    far = np.zeros(len(shares))
    for (structure, knobs), stopped in product(fits.items(), (False, True)):
        trusted = {**knobs, "far": widest} if stopped else knobs
        states = _reached(structure, knobs, course) + np.zeros(len(shares))
        for moment in range(round((LEG_S + FREE_S) / 0.1)):
            against = -0.8 * stopped * greatest * states[2:] / np.maximum(np.hypot(*states[2:]), 0.3)
            held = pushes if moment < round(LEG_S / 0.1) else against
            states = QUICK.advanced(structure, trusted, 0.0, states, 0.1, held)
            far = np.maximum(far, np.hypot(*states[:2]))
    return pushes[:, int(np.argmin(np.where(far < wanted, wanted - far, 10 * (far - wanted))))]


def solve(task):
    """Pushes that grow until the puck moves visibly; then swings out to near the rim, planned with quick fits."""
    seen, _ = yield from RIG.touched(0.01, 4.0, 0.1, lambda reading: reading[2] > 0.25)
    for leg in range(LEGS):
        course = RIG.course(seen)
        found = {structure: QUICK.fitted(course, structure) for structure in STRUCTURES}
        least = min(cost for cost, _ in found.values())
        fits = {structure: knobs for structure, (cost, knobs) in found.items() if cost < 2 * least + 50}
        widest = float(np.hypot(*course.readings[:, :2].T).max())
        wanted = min(0.4 + 0.2 * leg, 0.2 + 1.3 * widest, NEAR_M)
        calls = RIG.leg(_chosen(fits, course, widest, wanted), LEG_S, LOOKS)
        if len(seen) + len(calls) > CALLS:
            break
        seen += zip(calls, (yield calls), strict=True)
    yield [answer(MODEL.best(seen))]


PULSES = ((0.02, 0), (0, 0.06), (-0.2, 0), (0, -0.5), (1.5, 0), (0, 4.0), (-7.0, 0), (0, -7.0))


def batch(task):
    """Ever stronger pushes, and the same fit up to where the rim caught."""
    calls = [asked for strength in PULSES for asked in RIG.leg(strength, 0.5, 2)]
    readings = yield calls
    yield [answer(MODEL.best(list(zip(calls, readings, strict=True))))]


def stage(task):
    """Push outwards as hard as one can; the rim catches the puck."""
    readings = yield RIG.leg(GREATEST_N, 2.0)
    far, speed = readings[-2]["position"], readings[-1]["velocity"]
    yield [answer([abs(speed[1]), GREATEST_N, float(np.hypot(*far[:2]))])]


def measure(engine, knobs):
    """In the engine without rim: the pull from a step at rest at the distance; the shot."""
    free = engine.changed({"body[rim].pos": (1e6, 0.0, 0.0)})
    free.place("object_1", np.array([RADIUS_M, 0.0, float(free.pose("object_1").position[2])]), {})
    free.step(1)
    pull = -float(free.twist("object_1").linear[0]) * free.whole_steps(1.0)
    free = engine.changed({"body[rim].pos": (1e6, 0.0, 0.0)})
    free.set_velocity("object_1", np.array([SHOT_M_S, 0.0, 0.0]))
    while free.twist("object_1").linear[0] > 0:
        free.step(1)
    return [(pull * RADIUS_M) ** 0.5, knobs["m"] * pull, float(free.pose("object_1").position[0])]
