"""Scene 92: load the pan more and more, watch how it sinks on, fit gas and leak, find the force for the far place."""

import numpy as np

from scenes.courses import Laws, Predictor
from scenes.family import members
from scenes.loads import GRAVITY, Pan, ball, joined, looks
from scenes.protocol import answer

PAN = Pan(top_m=2.0, catch_m=0.22)
PRESSED_S, ASKED, DAMPING = 10.0, 0.45, 2.0
CONSTANTS = ("k", "oil", "column", "leak", "opens")
STRUCTURES = dict.fromkeys(("even", "root", "flat"), CONSTANTS)
BOX = {"oil": (0.5, 6.0), "column": (0.5, 0.8), "leak": (0.004, 0.06), "opens": (0.2, 0.4)}
"""`k` is the stiffness at first: pressure outside times area, over the height of the column."""
FIRST_KG, GROWTH, SEEN, SETTLE_S = 4e-5, 16.0, 0.004, 3.0
LIGHT, LIGHT_S = (0.12, 0.23), (2.0, 2.0)
"""Excesses of the pressure at which the valve is surely shut, and when the pan is looked at under each."""
STEP, LOOKS_S, ROOM = 0.05, (0.7, 0.7, 0.7), 0.21
"""By how much the excess grows from load to load, when the pan is looked at, and how far it may sink."""
COLUMN = 0.65
"""Height of the column that is supposed before it is known."""
CALLS, MOST_KG = 140, 299.9


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
    return Laws(
        rates=_rates,
        structures=STRUCTURES,
        box={**BOX, "k": (0.9 * k, 1.1 * k)},
        start=(0.0, 0.0),
        sigma=(6e-5,),
        longest_s=longest_s,
        starts=150,
        tried=3,
        rounds=12,
    )


def _stiffness(course):
    """Load over way at small ways."""
    loads, ways = course.controls[:, 0], course.readings[:, 0]
    small = np.flatnonzero((ways < 0.12) & (ways > 1e-3) & (loads > 0))
    best = small[np.argmax(ways[small])] if len(small) else int(np.argmin(ways))
    return float(loads[best] * (1 - ways[best] / COLUMN) / max(ways[best], 1e-4))


def predict(structure, knobs):
    """Force that brings the pan to the asked place: by trying many at once, in ever narrower ranges."""
    laws, area, low, high = _laws(1.0, 0.02), knobs["k"] * knobs["column"], 0.1, 5.0
    for _ in range(3):
        force = area * np.linspace(low, high, 60)
        trial = {name: np.full(60, knobs[name]) for name in STRUCTURES[structure]}
        state = np.zeros((2, 60))
        for _ in range(10):
            state = laws.advanced(structure, trial, 0.0, state, PRESSED_S / 10, force[None, :])
        beyond = int(np.clip(np.searchsorted(state[0], ASKED), 1, 59))
        low, high = force[beyond - 1] / area, force[beyond] / area
    part = (ASKED - state[0][beyond - 1]) / (state[0][beyond] - state[0][beyond - 1])
    return float(area * (low + part * (high - low)))


MODEL = Predictor(lambda course: _laws(_stiffness(course)), PAN.course, predict)
fit = MODEL.fit


def rivals(readings):
    """Every law of the leak, fitted."""
    course = PAN.course(readings)
    return members(_laws(_stiffness(course)), course, predict)


def _gas(course):
    """Pressure outside times area, and height of the column, from the places of rest under the two light loads."""
    (low, high), (near, far) = course.controls[[-3, -1], 0], course.readings[[-3, -1], 0]
    column = near * far * (high - low) / (high * near - low * far)
    return float(low * (column / near - 1)), float(column)


def solve(task):
    """Find the scale; then keep the pan close above the catch by ever lighter loads, while it loses its gas."""
    seen, number, _ = yield from PAN.scaled(FIRST_KG, GROWTH, SEEN, SETTLE_S)
    guess = COLUMN * _stiffness(PAN.course(seen))
    for turn, excess in enumerate(LIGHT, number):
        calls = PAN.load(turn, guess * excess / GRAVITY, LIGHT_S)
        seen += zip(calls, (yield calls), strict=True)
    area, column = _gas(PAN.course(seen))
    excess, left, lost, span = LIGHT[-1], 1.0, 0.0, sum(LOOKS_S)
    for turn in range(number + len(LIGHT), 19):
        excess = min(excess + STEP, (left - lost * span) / (1 - ROOM / column) - 1)
        calls = PAN.load(turn, area * excess / GRAVITY, LOOKS_S)
        if len(seen) + len(calls) > CALLS:
            break
        seen += zip(calls, (yield calls), strict=True)
        now = min(left, (1 - PAN.course(seen).readings[-1, 0] / column) * (1 + excess))
        left, lost = now, (left - now) / span
    yield [answer(MODEL.best(seen))]


HEAP_KG, RATIO, SPANS_S = 1e-2, 1.5, (1.2, 2.4)
"""First load and ratio of the loads of the fixed batch, and when each is looked at."""


def batch(task):
    """A heap of balls, in even ratios over the whole scale, each seen twice, and the best fit."""
    calls, kg = [], 0.0
    for rung in range(10):
        more = HEAP_KG * RATIO**rung - kg
        place = [0.3 * (rung % 5) - 0.6, 0.3 * (rung // 5) - 0.15, PAN.top_m]
        calls += [*joined(ball(f"b{rung}", more, place, PAN.radius), PAN.body), *looks(PAN.body, SPANS_S)]
        kg += more
    yield [answer(MODEL.best(list(zip(calls, (yield calls), strict=True))))]


def stage(task):
    """Press it down with all that may be made, for the time that is asked, and carry the way on in proportion."""
    readings = yield PAN.load(0, MOST_KG, [PRESSED_S], 2 * PAN.radius)
    yield [answer(MOST_KG * GRAVITY * ASKED / max(PAN.top_m - readings[-1]["position"][2], 0.05))]


def structure(knobs):
    """How the loss grows with the pressure."""
    return knobs["kind"]


def _true(knobs):
    return {**knobs, "k": knobs["area"] / knobs["column"], "oil": DAMPING}


def theory(knobs):
    """The force by the drawn laws."""
    return predict(knobs["kind"], _true(knobs))


def measure(engine, knobs):
    """The force by two runs in the engine without the catch."""
    near, free = theory(knobs), engine.changed(without=("tendon",))
    first, last = (PAN.way(PAN.pressed(free, share * near, PRESSED_S)) for share in (0.98, 1.02))
    return float(near * (0.98 + 0.04 * (ASKED - first) / (last - first)))


def naive(knobs):
    """The gas alone, without the leak; a spring of the stiffness at first."""
    gas = knobs["area"] * (1 / (1 - ASKED / knobs["column"]) - 1)
    return {"gas without leak": gas, "spring": knobs["area"] / knobs["column"] * ASKED}
