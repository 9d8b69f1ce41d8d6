"""Scene 89: swing the pendulums together and against each other as far as the pawls allow, fit each coupling."""

import numpy as np
from scipy.integrate import solve_ivp

from scenes.courses import Channel, Laws, Predictor
from scenes.family import members
from scenes.protocol import answer
from scenes.rigs import Rig

HELD_RAD = 1.8
GREATEST_NM, GREATEST_RAD_S2 = 5.9, 25.0
NEAR_RAD, PAWL_RAD = 0.67, 0.8
LEGS, LEG_S, COAST_S, LOOKS, CALLS = 11, 0.6, 2.0, 2, 150
PENDULUMS = ("object_1", "object_2")
TOGETHER, AGAINST = np.array([1.0, 1.0]), np.array([1.0, -1.0])
STRUCTURES = {
    "wire": ("i", "w", "d", "k"),
    "stiffening": ("i", "w", "d", "k", "b"),
    "magnets": ("i", "w", "d", "k"),
    "oil": ("i", "w", "d", "c"),
}


def _coupling(structure, knobs, gap, slip):
    """Torque of the coupling against a difference of angles and of spins, over the moment of inertia."""
    if structure == "oil":
        return knobs["c"] * slip
    if structure == "magnets":
        return knobs["k"] * np.sin(gap)
    return knobs["k"] * gap + (knobs["b"] * gap**3 if structure == "stiffening" else 0.0)


def _rates(structure, knobs, time, state, torques):
    """Time derivative of both angles and both spins."""
    first, second, spin, other = state
    passed = _coupling(structure, knobs, first - second, spin - other)
    return np.array(
        [
            spin,
            other,
            torques[0] / knobs["i"] - knobs["w"] * np.sin(first) - knobs["d"] * spin - passed,
            torques[1] / knobs["i"] - knobs["w"] * np.sin(second) - knobs["d"] * other + passed,
        ]
    )


def _laws(starts, tried, rounds):
    return Laws(
        rates=_rates,
        structures=STRUCTURES,
        box={"i": (0.0005, 0.8), "w": (2, 40), "d": (0.03, 1.5), "k": (1, 30), "b": (0.5, 15), "c": (0.3, 12)},
        start=(0.0, 0.0, 0.0, 0.0),
        sigma=(0.006, 0.006, 0.02, 0.02),
        longest_s=0.1,
        starts=starts,
        tried=tried,
        rounds=rounds,
    )


LAWS, QUICK = _laws(80, 3, 12), _laws(60, 1, 5)


RIG = Rig(
    [Channel("apply_torque", body, "torque_vector", 1) for body in PENDULUMS],
    [
        Channel(tool, body, field)
        for tool, field in (("get_position", "angle"), ("get_velocity", "angular_velocity"))
        for body in PENDULUMS
    ],
    decimals=6,
)


def _course(readings):
    """The course up to where a pawl caught a pendulum."""
    course = RIG.course(readings)
    kept = course.until(abs(course.readings[:, :2]).max(axis=1) > PAWL_RAD)
    return kept if kept.count else course


def predict(structure, knobs):
    """Torque that holds object_1, and its spin at angle 0 after the release, with object_2 clamped."""

    def rates(time, state):
        pull = knobs["w"] * np.sin(state[0]) + knobs["d"] * state[1]
        return [state[1], -pull - _coupling(structure, knobs, state[0], state[1])]

    def passes(time, state):
        return state[0]

    passes.terminal = True
    swing = solve_ivp(rates, (0, 100), [HELD_RAD, 0.0], events=passes, rtol=1e-8, atol=1e-9)
    held = knobs["w"] * np.sin(HELD_RAD) + _coupling(structure, knobs, HELD_RAD, 0.0)
    return [float(knobs["i"] * held), float(abs(swing.y[1, -1]))]


MODEL = Predictor(LAWS, _course, predict)
fit = MODEL.fit


def rivals(readings):
    """Each coupling, fitted."""
    return members(LAWS, _course(readings), predict)


def naive(knobs):
    """No coupling; a coupling in proportion to the difference; the torque of the weight as if it were a spring."""
    stiff = 0.0 if knobs["kind"] == "oil" else knobs["k"]
    return {
        "no coupling": predict("wire", {**knobs, "k": 0.0}),
        "all in proportion": [knobs["i"] * (knobs["w"] + stiff) * HELD_RAD, HELD_RAD * (knobs["w"] + stiff) ** 0.5],
    }


def _chosen(structure, knobs, state, pattern):
    """Torques of a leg for the widest swing of a kind, with neither pendulum too near to a pawl then or later."""
    greatest = min(GREATEST_NM, GREATEST_RAD_S2 * knobs["i"])
    shares = np.linspace(-1, 1, 41)
    torques = greatest * pattern[:, None] * shares
    states, far = np.array(state)[:, None] + np.zeros(len(shares)), np.zeros((2, len(shares)))
    for held, lasting in ((torques, LEG_S), (0 * torques, COAST_S)):
        for _ in range(round(lasting / 0.1)):
            states = QUICK.advanced(structure, knobs, 0.0, states, 0.1, held)
            far = np.maximum(far, [abs(states[:2]).max(axis=0), abs(pattern @ states[:2])])
    near = NEAR_RAD if pattern is AGAINST else NEAR_RAD / 2
    good = np.where(far[0] < near, far[1], -far[0])
    return torques[:, int(np.argmax(good))]


def solve(task):
    """Torques that grow until object_1 moves visibly; then swings of both kinds, planned with a quick fit."""
    seen, strength = yield from RIG.touched(0.006, 4.0, 0.1, lambda reading: reading[2] > 0.15)
    for leg in range(LEGS):
        if leg == 0:
            torques, duration = (0.5 * strength, -0.5 * strength), 0.2
        else:
            course = RIG.course(seen)
            fits = [(*QUICK.fitted(course, structure), structure) for structure in ("wire", "oil")]
            _, knobs, structure = min(fits, key=lambda found: found[0])
            pattern = TOGETHER if leg == 1 else AGAINST
            torques, duration = _chosen(structure, knobs, course.readings[-1], pattern), LEG_S
        calls = RIG.leg(torques, duration, LOOKS)
        if len(seen) + len(calls) > CALLS:
            break
        seen += zip(calls, (yield calls), strict=True)
    yield [answer(MODEL.best(seen))]


PULSES = ((0.02, 1), (-0.04, -1), (0.1, 1), (-0.2, -1), (0.5, 1), (-1.0, -1), (2.0, 1), (-4.0, -1))


def batch(task):
    """Swings of both kinds, ever stronger, and the same fit up to where a pawl caught."""
    calls = [asked for strength, side in PULSES for asked in RIG.leg((strength, side * strength), 0.4)]
    readings = yield calls
    yield [answer(MODEL.best(list(zip(calls, readings, strict=True))))]


def stage(task):
    """Turn object_1 to the angle; a pawl catches it."""
    readings = yield RIG.leg(GREATEST_NM, 2.0)
    yield [answer([GREATEST_NM, abs(readings[-2]["angular_velocity"])])]


def measure(engine, knobs):
    """In the engine without pawls, with object_2 too heavy to move: led there, held, and let go."""
    free = engine.changed({"body[pawls].pos": (1e6, 0.0, 0.0), "joint[object_2_joint].armature": 1e9})
    step, i = 1 / free.whole_steps(1.0), knobs["i"]
    angle = spin = lasting = torque = 0.0

    def moved(wanted):
        free.push("object_1", torque=np.array([0.0, wanted, 0.0]))
        free.step(1)
        later = float(free.twist("object_1").angular[1])
        return angle + (spin + later) / 2 * step, later

    for _ in range(free.whole_steps(3.0)):
        lasting += 8000 * i * (HELD_RAD - angle) * step
        torque = 1500 * i * (HELD_RAD - angle) - 60 * i * spin + lasting
        angle, spin = moved(torque)
    while angle > 0:
        last = angle, spin
        angle, spin = moved(0.0)
    share = last[0] / (last[0] - angle)
    return [torque, abs(last[1] + share * (spin - last[1]))]
