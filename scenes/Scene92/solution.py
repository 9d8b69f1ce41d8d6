"""Scene 92: load the pan more and more, watch how it sinks on, fit gas and leak, find the force for the far place."""

from math import pi

import numpy as np

from scenes.courses import Course, Laws
from scenes.protocol import answer, call

GRAVITY, TOP, CATCH = 9.81, 2.0, 0.22
PRESSED_S, ASKED, DAMPING = 10.0, 0.45, 2.0
RADIUS = 0.06
CONSTANTS = ("k", "oil", "column", "leak", "opens")
STRUCTURES = dict.fromkeys(("even", "root", "flat"), CONSTANTS)
BOX = {"oil": (0.5, 6.0), "column": (0.5, 0.8), "leak": (0.004, 0.06), "opens": (0.15, 0.35)}
"""`k` is the stiffness at first: pressure outside times area, over the height of the column."""
FIRST_KG, GROWTH, SEEN, SETTLE_S = 0.002, 4.0, 0.006, 3.0
LOOK_S, LOOKS, STEP, ROOM, COLUMN = 0.9, 3, 0.06, 0.21, 0.65
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


def _course(exchanges):
    """Loads and ways of the pan, until the catch holds it."""
    made, load, legs = {}, 0.0, []
    for asked, reading in exchanges:
        if "error" in reading:
            continue
        if asked.tool == "create_objects":
            made[asked.arguments["name"]] = asked.arguments["density"] * 4 / 3 * pi * asked.arguments["radius"] ** 3
        elif asked.tool == "attach_objects":
            load += made[asked.arguments["object1_id"]]
        elif asked.tool == "delete_objects":
            load -= made[asked.arguments["object_id"]]
        elif asked.tool == "step":
            legs.append([asked.arguments["duration"], load * GRAVITY, np.nan])
        elif asked.tool == "get_position" and legs:
            way = TOP - reading["position"][2]
            if way > CATCH + 0.005:
                legs.pop()
                break
            legs[-1][2] = way
    times, loads, ways = np.array(legs or [[1.0, 1.0, 0.1]]).T
    return Course(times, loads[:, None], ways[:, None])


def _stiffness(course):
    """Load over way at small ways."""
    loads, ways = course.controls[:, 0], course.readings[:, 0]
    small = np.flatnonzero((ways < 0.12) & (ways > 1e-3) & (loads > 0))
    best = small[np.argmax(ways[small])] if len(small) else int(np.argmin(ways))
    return float(loads[best] * (1 - ways[best] / COLUMN) / max(ways[best], 1e-4))


def _force(structure, knobs):
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


def _best(exchanges):
    """The force by the law that fits best."""
    course = _course(exchanges)
    return _force(*_laws(_stiffness(course)).best(course))


def fit(readings, structure):
    """The force by one law of the leak."""
    course = _course(readings)
    return _force(structure, _laws(_stiffness(course)).fitted(course, structure)[1])


def _looks(spans):
    return [
        made for span in spans for made in (call("step", duration=span), call("get_position", object_id="object_1"))
    ]


def _load(number, kg, spans, radius=RADIUS):
    """Load the pan with a ball instead of the one before, and look at it."""
    where = [0.0, 0.3 * (number % 2) - 0.15, TOP]
    made = call(
        "create_objects",
        name=f"b{number}",
        pos=where,
        density=kg / (4 / 3 * pi * radius**3),
        rgba=[1, 0, 0, 1],
        radius=radius,
    )
    old = [call("delete_objects", object_id=f"b{number - 1}")] if number else []
    return [made, call("attach_objects", object1_id=f"b{number}", object2_id="object_1"), *old, *_looks(spans)]


def solve(task):
    """Find the scale; then load more in small steps, as long as there is room above the catch."""
    seen, number, kg = [], 0, FIRST_KG
    while not seen or _course(seen).readings[-1, 0] < SEEN:
        calls = _load(number, kg, [SETTLE_S])
        seen += zip(calls, (yield calls), strict=True)
        number, kg = number + 1, kg * GROWTH
    area, excess = _stiffness(_course(seen)) * COLUMN, 0.06
    for ball in range(number, 19):
        course = _course(seen)
        ways, rate = course.readings[:, 0], 0.0
        now = course.controls[-1, 0] / area
        left = (1 - ways[-1] / COLUMN) * (1 + now)
        if ball > number:
            rate = max(ways[-1] - ways[-2], 0.0) / course.durations[-1]
        excess = excess + STEP
        if COLUMN * (1 - left / (1 + excess)) + 1.5 * rate * LOOK_S * LOOKS > ROOM:
            excess = max(0.6 * now, 0.15)
        calls = _load(ball, area * excess / GRAVITY, [LOOK_S] * LOOKS)
        if COLUMN * (1 - left / (1 + excess)) > ROOM or len(seen) + len(calls) > CALLS:
            break
        seen += zip(calls, (yield calls), strict=True)
    yield [answer(_best(seen))]


def batch(task):
    """Loads in even ratios, two looks at each, and the best fit."""
    calls = []
    for rung in range(8):
        calls += _load(rung, 0.05 * 2.0**rung, [2.0, 2.0])
    yield [answer(_best(list(zip(calls, (yield calls), strict=True))))]


def stage(task):
    """Press it down with all that may be made, for the time that is asked, and carry the way on in proportion."""
    readings = yield _load(0, MOST_KG, [PRESSED_S], 2 * RADIUS)
    yield [answer(MOST_KG * GRAVITY * ASKED / max(TOP - readings[-1]["position"][2], 0.05))]


def structure(knobs):
    """How the loss grows with the pressure."""
    return knobs["kind"]


def _true(knobs):
    return {**knobs, "k": knobs["area"] / knobs["column"], "oil": DAMPING}


def theory(knobs):
    """The force by the drawn laws."""
    return _force(knobs["kind"], _true(knobs))


def measure(engine, knobs):
    """The force by two trials in the engine without the catch."""

    def reached(force):
        changes = {"joint[guide].range": (-5.0, 20.0), "body[trigger]/inertial.mass": 1e12}
        free = engine.changed(changes)
        free.push("object_1", force=np.array([0.0, 0.0, -force]))
        free.step(free.whole_steps(PRESSED_S))
        return TOP - float(free.pose("object_1").position[2])

    near = theory(knobs)
    first, last = reached(0.98 * near), reached(1.02 * near)
    return float(near * (0.98 + 0.04 * (ASKED - first) / (last - first)))


def naive(knobs):
    """The gas alone, without the leak; a spring of the stiffness at first."""
    gas = knobs["area"] * (1 / (1 - ASKED / knobs["column"]) - 1)
    return {"gas without leak": gas, "spring": knobs["area"] / knobs["column"] * ASKED}
