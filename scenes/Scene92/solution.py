"""Scene 92: load the pan more and more, watch how it sinks on, fit gas and leak, find the force for the far place."""

import numpy as np

from scenes.courses import Laws, Predictor
from scenes.family import members
from scenes.loads import GRAVITY, Pan
from scenes.protocol import answer

PAN = Pan(top_m=2.0, catch_m=0.22)
PRESSED_S, ASKED, DAMPING = 10.0, 0.45, 4.0
STRUCTURES = dict.fromkeys(("even", "root", "flat"), ("k", "oil", "column", "leak", "opens"))
BOX = {"oil": (1.0, 12.0), "column": (0.5, 0.8), "leak": (0.004, 0.06), "opens": (0.15, 0.35)}
"""`k` is the stiffness at first: pressure outside times area, over the height of the column."""
SETTLE_S = 6.0
LOOK_S, LOOKS, STEP, ROOM, COLUMN = 1.4, 3, 0.06, 0.21, 0.65
CALLS, MOST_KG = 117, 299.9


def _rates(structure, knobs, time, state, force):
    """Time derivative of the way of the pan and of the part of the gas that is lost."""
    z, lost = np.clip(state, -10.0, 10.0)
    area = knobs["k"] * knobs["column"]
    over = (1 - lost) / np.maximum(1 - z / knobs["column"], 0.02) - 1
    above = np.maximum(over - knobs["opens"], 0.0)
    if structure == "even":
        flow = 2 * above
    elif structure == "root":
        flow = np.sqrt(above)
    else:
        flow = 0.5 * np.minimum(above / 0.02, 1.0)
    return np.array([(force[0] / area - over) / knobs["oil"], knobs["leak"] * flow])


def _laws(k, longest_s=0.15):
    """The laws, with stiffnesses near a known one."""
    box = {**BOX, "k": (0.85 * k, 1.15 * k)}
    return Laws(_rates, STRUCTURES, box, (0.0, 0.0), (4e-5,), longest_s, starts=150, tried=3, rounds=12)


def _stiffness(course):
    """Load over way at small ways."""
    loads, ways = course.controls[:, 0], course.readings[:, 0]
    small = np.flatnonzero((ways < 0.12) & (ways > 1e-3) & (loads > 0))
    best = small[np.argmax(ways[small])] if len(small) else int(np.argmin(ways))
    return float(loads[best] * (1 - ways[best] / COLUMN) / max(ways[best], 1e-4))


def _force(structure, knobs):
    """Force that brings the pan to the asked place: by trying many at once, in ever narrower ranges."""
    laws, area, low, high = _laws(1.0, 0.02), knobs["k"] * knobs["column"], 0.1, 8.0
    for _ in range(3):
        force = area * np.linspace(low, high, 60)
        trial = {name: np.full(60, knobs[name]) for name in STRUCTURES[structure]}
        state = laws.advanced(structure, trial, 0.0, np.zeros((2, 60)), PRESSED_S, force[None, :])
        beyond = int(np.clip(np.searchsorted(state[0], ASKED), 1, 59))
        low, high = force[beyond - 1] / area, force[beyond] / area
    part = (ASKED - state[0][beyond - 1]) / (state[0][beyond] - state[0][beyond - 1])
    return float(area * (low + part * (high - low)))


MODEL = Predictor(lambda course: _laws(_stiffness(course)), PAN.course, _force)
fit = MODEL.fit


def rivals(readings):
    """Every law of the leak, fitted."""
    course = PAN.course(readings)
    return members(_laws(_stiffness(course)), course, _force)


def solve(task):
    """Find the scale; then load more in small steps, as long as there is room above the catch."""
    seen, number, _ = yield from PAN.scaled(0.002, 4.0, 0.006, SETTLE_S)
    area, excess = _stiffness(PAN.course(seen)) * COLUMN, 0.06
    for ball in range(number, 19):
        course = PAN.course(seen)
        ways, rate = course.readings[:, 0], 0.0
        now = course.controls[-1, 0] / area
        left = (1 - ways[-1] / COLUMN) * (1 + now)
        if ball > number:
            rate = max(ways[-1] - ways[-2], 0.0) / course.durations[-1]
        excess = excess + STEP
        if COLUMN * (1 - left / (1 + excess)) + 1.5 * rate * LOOK_S * LOOKS > ROOM:
            excess = max(0.6 * now, 0.15)
        calls = PAN.load(ball, area * excess / GRAVITY, [LOOK_S] * LOOKS)
        if COLUMN * (1 - left / (1 + excess)) > ROOM or len(seen) + len(calls) > CALLS:
            break
        seen += zip(calls, (yield calls), strict=True)
    yield [answer(MODEL.best(seen))]


def batch(task):
    """Loads in even ratios, two looks at each, and the best fit."""
    calls = []
    for rung in range(8):
        calls += PAN.load(rung, 0.05 * 2.0**rung, [2.0, 2.0])
    yield [answer(MODEL.best(list(zip(calls, (yield calls), strict=True))))]


def stage(task):
    """Press it down with all that may be made, for the time that is asked, and carry the way on in proportion."""
    readings = yield PAN.load(0, MOST_KG, [PRESSED_S], 2 * PAN.radius)
    yield [answer(MOST_KG * GRAVITY * ASKED / max(PAN.top_m - readings[-1]["position"][2], 0.05))]


def theory(knobs):
    """The force by the drawn laws."""
    return _force(knobs["kind"], {**knobs, "k": knobs["area"] / knobs["column"], "oil": DAMPING})


def measure(engine, knobs):
    """The force by two trials in the engine without the catch."""
    near = theory(knobs)
    first, last = (PAN.way(PAN.pressed(engine, part * near, PRESSED_S)) for part in (0.98, 1.02))
    return float(near * (0.98 + 0.04 * (ASKED - first) / (last - first)))


def naive(knobs):
    """The gas alone, without the leak; a spring of the stiffness at first."""
    gas = knobs["area"] * (1 / (1 - ASKED / knobs["column"]) - 1)
    return {"gas without leak": gas, "spring": knobs["area"] / knobs["column"] * ASKED}
