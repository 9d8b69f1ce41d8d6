"""Scene 97: the scale from a slack line, drag and line from still water, the stream from slow passages.

Forces are divided by R, the resistance of the second cart's rail, so that their unit is m/s.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.optimize import brentq, least_squares

from scenes.family import member
from scenes.protocol import answer, call

CART, START = "object_1", 0.4
PARTS, MOST, NAIL, FARTHEST = 6.0, 5.6, 12.0, 9.3
"""Pull that parts the line, and greatest force used, over R [m/s]; places of the nail and of the last passage [m]."""
TOUCH_N, TOUCH_S, TOUCHES, LAG = 0.03, 0.4, 3, 0.40
"""First push [N], its time [s], most of such pushes, and mass over resistance of a cart [s]."""
SEEN = 0.05
"""Speed from which on a push tells R roughly [m/s]."""
SLACK, SLACK_S, SHORTEST = 0.5, 1.6, 0.6
"""Push with which R is found, over its first estimate [m/s]; its time [s]; smallest free length [m]."""
FASTER = 2.5
TOWS = ((-0.5, 11.0, 1.5), (-1.5, 5.0, 1.0), (-3.5, 3.5, 0.5), (-MOST, 2.5, 0.4))
"""Force, time to settle and pause between two looks in still water."""
CREEP, STRETCH = 0.35, 1.3
CALLS, TIME_S = 150, 100.0
READ_M, READ_V = 0.001, 0.0008
"""Standard deviations of lengths and speeds."""
SOFTEST, WIDTH = 0.5, 0.05
"""A large compliance of the line, times R [s]; width of a step of the stream [m]."""
POWERS = (0, 1)
LABELS = tuple(
    f"{profile} {power} {line}"
    for profile in ("even", "rising", "step")
    for power in POWERS
    for line in ("softer", "stiffer")
)
EDGES, PLACES, MIDDLE = (0.9, 1.6), (2.8, 6.0), 1.25
"""Where the stream begins, where it may become faster in a step, and the middle of the former [m]."""
PRICE = 4.0
"""What a constant more must gain in chi-square."""


def _look(duration, tug):
    return [
        call("step", duration=round(duration, 2)),
        call("get_position", object_id=CART),
        call("get_position", object_id=tug),
        call("get_velocity", object_id=CART),
        call("get_velocity", object_id=tug),
    ]


def _glance(duration, tug):
    """The speeds alone, from which the next look has its changes of speed."""
    step, *_, speed, tug_speed = _look(duration, tug)
    return [step, speed, tug_speed]


def _pull(force, tug):
    return call("apply_force", object_id=tug, force_vector=[round(force, 4), 0, 0])


def _weighed(tug, history):
    """Push the tug while the line is slack: ten times as hard until it is seen to move, then back; R."""
    force = TOUCH_N
    for _ in range(TOUCHES):
        calls = [_pull(force, tug), *_look(TOUCH_S, tug)]
        history.extend(zip(calls, (yield calls), strict=True))
        rows, scale = _rows(history)
        if rows[-1, 4] > SEEN:
            break
        force *= 10
    calls = [_pull(-SLACK * scale, tug), *_look(SLACK_S, tug)]
    history.extend(zip(calls, (yield calls), strict=True))
    return _rows(history)[1]


def _scale(rows):
    """R from the greatest change of speed that a push gave the tug while the line was slack [N·s/m]."""
    best, scale = 1e-6, 1.0
    for before, now in pairwise(rows):
        left = np.exp(-(now[0] - before[0]) / LAG)
        gain = now[4] - before[4] * left
        slack = abs(before[3]) < SHORTEST and abs(now[3]) < SHORTEST
        if slack and abs(gain) > best and gain * now[5] > 0:
            best, scale = abs(gain), now[5] * (1 - left) / gain
    return float(scale)


def _rows(exchanges):
    """Rows of time, place and speed of the cart, length of the line, speed of the tug, force over R; and R.

    What was not read is NaN.
    """
    rows, force, time, looked = [(0.0, 0.0, 0.0, START, 0.0, 0.0)], 0.0, 0.0, {}
    for asked, reading in exchanges:
        if asked.tool == "apply_force":
            force = asked.arguments["force_vector"][0]
        elif asked.tool == "step":
            time, looked = time + asked.arguments["duration"], {}
        elif asked.tool in ("get_position", "get_velocity"):
            kind = asked.tool[4:]
            looked[kind, asked.arguments["object_id"] == CART] = reading[kind][0]
            if ("velocity", True) in looked and ("velocity", False) in looked:
                x, tug = (looked.get(("position", cart), np.nan) for cart in (True, False))
                rows.append((time, x, looked["velocity", True], tug - x, looked["velocity", False], force))
    rows = np.array(rows)
    scale = _scale(rows)
    return rows / [1, 1, 1, 1, 1, scale], scale


def _steady(rows):
    """Rows with little change of speed: pull of the line, its length, place and speed of the cart, error of the pull.

    First rows under a force are left out, and so is what follows after the line was parted. What is left of the
    acceleration is between none and its mean since the look before.
    """
    time, _, speed, apart, tug, force = rows.T
    before = np.maximum(np.arange(len(rows)) - 1, 0)
    gain, tug_gain = np.array([v - v[before] for v in (speed, tug)]) / np.maximum(time - time[before], 1e-3)
    pull = force - tug - LAG * tug_gain / 2
    error = LAG * np.maximum(np.abs(gain), np.abs(tug_gain)) / 2
    kept = (error < 0.05 * np.abs(pull)) & (np.abs(pull) > 0.1) & (apart * pull > 0) & (force == force[before])
    kept &= (np.arange(len(rows)) > 0) & (np.abs(pull) < PARTS) & (np.abs(apart) < NAIL)
    return np.column_stack([pull, np.abs(apart), rows[:, 1], speed, error])[kept]


def _sizes(steady):
    """For either power: variance of the logarithm of the size of the drag in still water, and its mean."""
    pull, _, x, speed, _ = steady.T
    still = (x < EDGES[0] - 0.15) & (np.abs(speed) > 0.02)
    if not still.any():
        raise ValueError("no look in still water")
    logs, force = np.log(np.abs(speed[still])), np.log(np.abs(pull[still]))
    return {
        power: (float(np.var(force - (1 + power) * logs)), float(np.mean(force - (1 + power) * logs)))
        for power in POWERS
    }


@dataclass(frozen=True)
class _Model:
    """Laws of one structure, with the place of the step between two looks."""

    profile: str
    power: int
    line: str
    step: tuple[float, float] = PLACES

    @property
    def ranges(self):
        """Of logarithm of the drag; length at a pull of 2, compliance beyond the bend, bend, ratio; stream, more."""
        more = {"even": [], "rising": [(0.045, 0.14)], "step": [(0.25, 0.55), self.step]}[self.profile]
        return [(-1.0, 4.0), (0.6, 4.0), (0.02, 1.5), (0.6, 1.5), (2.2, 3.2), (0.1, 5.0), *more]

    def length(self, constants, pull):
        """Length of the line under a pull."""
        _, middle, beyond, bend, ratio, *_ = constants
        first = beyond / ratio if self.line == "softer" else beyond * ratio
        return middle + beyond * (np.maximum(pull, bend) - 2.0) - first * np.maximum(bend - pull, 0.0)

    def stream(self, constants, x):
        """Speed of the stream within its region."""
        u, more = constants[5], constants[6:]
        if self.profile == "rising":
            return u * (1 + more[0] * (x - MIDDLE))
        return u * (1 + more[0] * (1 + np.tanh((x - more[1]) / WIDTH)) / 2) if self.profile == "step" else u + 0 * x

    def misfits(self, steady):
        """Misfits of lengths and of speeds through the water, in standard deviations, as a function of constants."""
        pull, apart, x, speed, error = steady.T
        inside = x > EDGES[1] + 0.15
        known = inside | (x < EDGES[0] - 0.15)

        def off(constants):
            through = np.sign(pull) * (np.abs(pull) * np.exp(-constants[0])) ** (1 / (1 + self.power))
            stream = np.where(inside, self.stream(constants, x), 0.0)
            of_pull = error * np.abs(through / pull) / (1 + self.power)
            water = (through - speed - stream) / np.hypot(READ_V + 0.001 * np.abs(through), of_pull)
            line = (self.length(constants, np.abs(pull)) - apart) / np.hypot(READ_M, SOFTEST * error)
            return np.concatenate([line, np.where(known, water, 0.0)])

        return off

    def predict(self, constants):
        """The asked length."""
        return _predict(
            lambda pull: self.length(constants, pull),
            lambda x: self.stream(constants, x),
            self.power,
            np.exp(constants[0]),
        )

    def fitted(self, steady, line):
        """Chi-square and the constants that fit best, from those of the line."""
        pull, _, x, speed, _ = steady.T
        low, high = np.array(self.ranges).T
        size = _sizes(steady)[self.power][1]
        inside = x > EDGES[1] + 0.15
        u = (np.abs(pull) * np.exp(-size)) ** (1 / (1 + self.power)) - speed
        first = float(np.mean(u[inside][:2])) if inside.any() else 0.5
        more = {"even": [], "rising": [0.09], "step": [0.4, sum(self.step) / 2]}[self.profile]
        begin = np.clip([size, *line, first, *more], low + 1e-6, high - 1e-6)
        best = least_squares(self.misfits(steady), begin, bounds=(low, high), x_scale=high - low, max_nfev=100)
        return 2 * float(best.cost), best.x

    def line_alone(self, steady):
        """Constants of the line that fit best, from several bends."""
        pull, apart = np.abs(steady[:, 0]), steady[:, 1]
        low, high = np.array(self.ranges[1:5]).T
        strong = pull > 1.5
        beyond, at = np.linalg.lstsq(np.column_stack([pull, np.ones_like(pull)])[strong], apart[strong])[0]

        def off(line):
            return (self.length([0.0, *line], pull) - apart) / READ_M

        starts = [np.clip([at + 2 * beyond, beyond, bend, 2.7], low + 1e-6, high - 1e-6) for bend in (0.7, 1.05, 1.4)]
        found = [least_squares(off, start, bounds=(low, high), x_scale=high - low) for start in starts]
        return min(found, key=lambda tried: tried.cost).x


def _models(steady, label):
    """The models of a structure: a step may be between any two looks."""
    profile, power, line = label.split()
    x = np.sort(steady[:, 2])
    x = np.unique(np.clip(np.concatenate([PLACES, x]), *PLACES))
    steps = list(pairwise(x)) if profile == "step" else [PLACES]
    return [_Model(profile, int(power), line, step) for step in steps if step[1] - step[0] > 1e-3]


def _fitted(steady, label):
    """Chi-square, constants, and the model of a structure that fits best."""
    models = _models(steady, label)
    line = models[0].line_alone(steady)
    return min(((*model.fitted(steady, line), model) for model in models), key=lambda found: found[0])


def _best(steady):
    """The answer by the structure that fits best."""
    found = [_fitted(steady, label) for label in LABELS]
    _, constants, model = min(found, key=lambda each: each[0] + PRICE * len(each[1]))
    return model.predict(constants)


def _predict(length, stream, power, size):
    """Length of the line where it balances the drag of the faster stream."""

    def surplus(reach):
        return reach - length(size * (FASTER * stream(NAIL - reach)) ** (1 + power))

    if surplus(NAIL - 1.0) < 0:
        return NAIL - 1.0  # a stream that carries the cart away
    return float(brentq(surplus, 0.1, NAIL - 1.0))


def solve(task):
    """A weak push and the scale; still water at four forces; back, and slowly against the stream."""
    reading = (yield [call("find_objects")])[0]
    tug = reading["revealed"][0]["object_id"]
    history = []
    scale = yield from _weighed(tug, history)

    def made(calls, readings):
        history.extend(zip(calls, readings, strict=True))
        return _rows(history)[0]

    def towed(force):
        return _pull(force * scale, tug)

    calls = [
        asked for force, settle, pause in TOWS for asked in (towed(force), *_glance(settle, tug), *_look(pause, tug))
    ]
    rows = made(calls, (yield calls))
    sizes = _sizes(_steady(rows))
    power = min(sizes, key=lambda each: sizes[each][0])
    size = np.exp(sizes[power][1])

    def tow(speed, stream):
        return min(size * (speed + stream) ** (1 + power) + speed, MOST)

    # The tug turns round: it goes through the slack slowly, so that the line is not parted, before it tows again.
    fast = brentq(lambda v: size * v ** (1 + power) + v - 4.0, 0.0, 9.0)
    calls = [towed(1.0), *_look(2 * abs(rows[-1, 3]) + 0.5, tug)]
    rows = made(calls, (yield calls))
    calls = [towed(4.0), *_look(max(0.75 * (0.3 - rows[-1, 1]) / fast, 0.5), tug)]
    rows = made(calls, (yield calls))
    stream, stuck = 0.0, 0
    while rows[-1, 1] < FARTHEST and stuck < 3:
        left = TIME_S - rows[-1, 0]
        x, speed = rows[-1, 1:3]
        if x < 0.6:
            calls = [towed(4.0), *_look(max(0.95 * (0.9 - x) / max(speed, 0.15), 0.4), tug)]
        else:
            # A line swings beyond its new pull by what the pull grew, at most: so far it must not come.
            force = min(tow(CREEP, stream), (PARTS + max(rows[-1, 5] - rows[-1, 4], 0.0)) / 2)
            pace = min(max(speed if force == rows[-1, 5] else CREEP, 0.12), 1.0)
            calls = [towed(force), *_glance(STRETCH / 2 / pace, tug), *_look(STRETCH / 2 / pace, tug)]
        if (
            len(history) + 1 + len(calls) > CALLS
            or sum(c.arguments["duration"] for c in calls if c.tool == "step") > left
        ):
            break
        rows = made(calls, (yield calls))
        _, x, speed, _, tug_speed, force = rows[-1]
        if x > 0.9 and force - tug_speed > 0.05:
            stream = max(((force - tug_speed) / size) ** (1 / (1 + power)) - speed, 0.0)
            stream += 0.15 * (speed < 0.05)
        stuck = stuck + 1 if force >= MOST - 0.01 and speed < 0.03 else 0
    yield [answer(_best(_steady(rows)))]


def structure(knobs):
    """How the stream depends on the place, the power of the drag, and how the line goes on."""
    return f"{knobs['profile']} {knobs['power']} {knobs['line']}"


def fit(readings, structure):
    """The answer by the laws of a structure, fitted to the readings."""
    _, constants, model = _fitted(_steady(_rows(readings)[0]), structure)
    return model.predict(constants)


def rivals(readings):
    """Every structure, fitted."""
    steady = _steady(_rows(readings)[0])

    def of(label):
        _, constants, model = _fitted(steady, label)
        return member(model.misfits(steady), model.predict, constants, model.ranges)

    return {label: of(label) for label in LABELS}


PLAN = ((4.5, 4.0, (2.0, 2.0, 3.0, 3.0)), (-0.7, 14.0, (2.0,)), (-3.0, 4.0, (1.0,)), (-5.5, 3.0, (0.5,)))
"""Forces [N] of the fixed batch, the time before speeds are read, and the times between looks [s]."""


def batch(task):
    """Forces laid down beforehand for the middle of what R may be; changes of speed are counted.

    Forces over the whole range, each three times the one before, do worse: at most two of them are of use at any one R.
    """
    tug = "object_2"
    calls = [call("find_objects"), _pull(1.0, tug), *_look(TOUCH_S, tug), call("step", duration=2.0)]
    for force, settle, waits in PLAN:
        calls += [_pull(force, tug), *_glance(settle, tug), *(asked for wait in waits for asked in _look(wait, tug))]
    steady = _steady(_rows(zip(calls, (yield calls), strict=True))[0])
    try:
        value = _best(steady)
    except (ValueError, ArithmeticError, IndexError, TypeError, np.linalg.LinAlgError):
        value = float(max(steady[:, 1], default=3.0))
    yield [answer(value)]


def stage(task):
    """Find R, hold the tug in the stream with almost all that the line bears, and read how long the line is."""
    tug = "object_2"
    yield [call("find_objects")]
    scale = yield from _weighed(tug, [])
    calls = [asked for force in (1.0, 3.0, MOST) for asked in (_pull(force * scale, tug), *_look(20.0, tug))]
    readings = yield calls
    yield [answer(abs(readings[-3]["position"][0] - readings[-4]["position"][0]))]


def _known(knobs):
    """Length at a pull, stream at a place, power and size of the drag, as drawn; forces over R."""

    def length(at):
        return knobs["free"] + min(at, knobs["bend"]) / knobs["k1"] + max(at - knobs["bend"], 0.0) / knobs["k2"]

    def stream(at):
        beyond = (1 + np.tanh((at - knobs["place"]) / 0.05)) / 2
        rise = 1 + knobs["growth"] * max(0.0, at - knobs["edge"]) + knobs["jump"] * beyond
        return knobs["u0"] * rise * (1 + np.tanh((at - knobs["edge"]) / 0.05)) / 2

    return length, stream, knobs["power"], knobs["c"]


def theory(knobs):
    """Balance of line and drag in the faster stream."""
    return _predict(*_known(knobs))


def naive(knobs):
    """The first stiffness carried on; the other power of the speed; length in proportion to the force."""
    length, stream, power, size = _known(knobs)
    first, full = knobs["free"], length(PARTS)

    def carried(at):
        return first + at / knobs["k1"]

    force = size * stream(2.0) ** (1 + power)
    return {
        "one stiffness": _predict(carried, stream, power, size),
        "line without slack, force at the edge in proportion": FASTER * force / PARTS * full,
        "drag not changed": _predict(length, lambda at: stream(at) / FASTER, power, size),
    }


def _rest(engine, place, seconds):
    """Length of the line some time after the cart was let go at a place, with the tug nailed, in the faster stream."""
    world = engine.changed(
        {
            "body[object_1].pos": (place, 0.0, 1.0),
            "body[object_2].pos": (NAIL, 0.5, 1.0),
            "body[object_2]/inertial.mass": 1e9,
            "body[weir].pos": (0.0, 1.0, 1.0),
            "body[device].pos": (0.0, 2.0, 1e9),
        }
    )
    world.step(world.whole_steps(seconds))
    return float(world.pose("object_2").position[0] - world.pose(CART).position[0])


def measure(engine, knobs):
    """The nailed tug and the faster stream in the engine, let go near the balance."""
    return _rest(engine, NAIL - theory(knobs) - 0.3, 60.0)


def settles(engine, knobs, off):
    """Let go with the line longer than in the balance by this share of its length."""
    balance = theory(knobs)
    return _rest(engine, NAIL - balance * (1 + off), 60.0) / balance - 1
