"""Scene 107: load the pan just beyond the yield of the putty, fit how it sinks, find the force for the big set."""

from math import pi

import numpy as np

from scenes.courses import Course, Laws
from scenes.protocol import answer, call

GRAVITY, TOP, CATCH = 9.81, 2.0, 0.2
PRESSED_S, SET = 10.0, 0.4
RADIUS = 0.06
COMMON = ("k", "oil", "edge", "tau")
STRUCTURES = {"even": COMMON, "square": COMMON, "hard": (*COMMON, "stiff")}
BOX = {"oil": (0.1, 1.0), "edge": (0.09, 0.14), "tau": (2.0, 30.0), "stiff": (0.5, 8.0)}
FIRST_KG, GROWTH, SEEN, SETTLE_S = 0.002, 4.0, 0.008, 2.0
LOOK_S, LOOKS, STEP, ROOM = 0.8, 3, 0.011, 0.19
CALLS = 112


def _rates(structure, knobs, time, state, force):
    """Time derivative of the ways of pan and putty."""
    z, s = np.clip(state, -10.0, 10.0)
    squeeze = z - s
    over = np.maximum(squeeze - knobs["edge"] - (knobs["stiff"] * s if structure == "hard" else 0.0), 0.0)
    flow = over**2 * 20 if structure == "square" else over
    return np.array([(force[0] / knobs["k"] - squeeze) / knobs["oil"], flow / knobs["tau"]])


def _laws(k):
    """The laws, with stiffnesses near a known one."""
    return Laws(
        rates=_rates,
        structures=STRUCTURES,
        box={**BOX, "k": (0.93 * k, 1.07 * k)},
        start=(0.0, 0.0),
        sigma=(6e-5,),
        longest_s=0.2,
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
    """Load over way of the largest way at which the putty surely stays."""
    loads, ways = course.controls[:, 0], course.readings[:, 0]
    elastic = np.flatnonzero((ways < 0.095) & (ways > 1e-4))
    best = elastic[np.argmax(ways[elastic])] if len(elastic) else int(np.argmin(ways))
    return float(loads[best] / max(ways[best], 1e-4))


def _force(structure, knobs):
    """Force that leaves the asked set: by trying many at once, in ever narrower ranges."""
    laws, low, high = _laws(1.0), knobs["edge"], 8.0
    for _ in range(3):
        force = knobs["k"] * np.linspace(low, high, 60)
        state = np.zeros((2, 60))
        trial = {name: np.full(60, knobs[name]) for name in STRUCTURES[structure]}
        for duration, push in ((PRESSED_S, force), (5.0, 0 * force)):
            state = laws.advanced(structure, trial, 0.0, state, duration, push[None, :])
        beyond = int(np.clip(np.searchsorted(state[1], SET), 1, 59))
        low, high = force[beyond - 1] / knobs["k"], force[beyond] / knobs["k"]
    part = (SET - state[1][beyond - 1]) / (state[1][beyond] - state[1][beyond - 1])
    return float(knobs["k"] * (low + part * (high - low)))


def _best(exchanges):
    """The force by the law that fits best."""
    course = _course(exchanges)
    return _force(*_laws(_stiffness(course)).best(course))


def fit(readings, structure):
    """The force by one law of the putty."""
    course = _course(readings)
    return _force(structure, _laws(_stiffness(course)).fitted(course, structure)[1])


def _looks(spans):
    return [
        made for span in spans for made in (call("step", duration=span), call("get_position", object_id="object_1"))
    ]


def _load(number, kg, spans):
    """Load the pan with a ball instead of the one before, and look at it."""
    where = [0.0, 0.3 * (number % 2) - 0.15, TOP]
    made = call(
        "create_objects",
        name=f"b{number}",
        pos=where,
        density=kg / (4 / 3 * pi * RADIUS**3),
        rgba=[1, 0, 0, 1],
        radius=RADIUS,
    )
    old = [call("delete_objects", object_id=f"b{number - 1}")] if number else []
    return [made, call("attach_objects", object1_id=f"b{number}", object2_id="object_1"), *old, *_looks(spans)]


def solve(task):
    """Find the scale; then load beyond the yield in small steps, as long as there is room above the catch."""
    seen, number, kg = [], 0, FIRST_KG
    while not seen or _course(seen).readings[-1, 0] < SEEN:
        calls = _load(number, kg, [SETTLE_S])
        seen += zip(calls, (yield calls), strict=True)
        number, kg = number + 1, kg * GROWTH
    kg = kg / GROWTH * 0.085 / _course(seen).readings[-1, 0]
    calls = _load(number, kg, [1.5, 1.0])
    seen += zip(calls, (yield calls), strict=True)
    k, squeeze = _stiffness(_course(seen)), 0.098
    for ball in range(number + 1, 18):
        course = _course(seen)
        ways = course.readings[:, 0]
        rate = max(ways[-1] - ways[-2], 0.0) / course.durations[-1] if squeeze > 0.099 else 0.0
        sunk = max(ways[-1] - course.controls[-1, 0] / k, 0.0)
        room = ROOM - sunk - 1.6 * rate * LOOK_S * LOOKS
        squeeze = squeeze + STEP if squeeze + STEP < room else max(0.75 * squeeze, 0.1)
        calls = _load(ball, k * squeeze / GRAVITY, [LOOK_S] * LOOKS)
        if squeeze + sunk > ROOM or len(seen) + len(calls) > CALLS:
            break
        seen += zip(calls, (yield calls), strict=True)
    yield [answer(_best(seen))]


def batch(task):
    """Loads in even ratios, two looks at each, and the best fit."""
    calls = []
    for rung in range(8):
        calls += _load(rung, 0.03 * 1.9**rung, [2.0, 2.0])
    yield [answer(_best(list(zip(calls, (yield calls), strict=True))))]


def stage(task):
    """Press it down at once."""
    readings = yield _load(0, 20.0, [2.0])
    yield [answer(20.0 * GRAVITY * SET / max(TOP - readings[-1]["position"][2], 0.05))]


def structure(knobs):
    """How fast the putty sinks."""
    return knobs["kind"]


def theory(knobs):
    """The force by the drawn laws."""
    return _force(knobs["kind"], {**knobs, "oil": 0.3})


def measure(engine, knobs):
    """The force by two trials in the engine without the catch."""

    def left(force):
        changes = {"joint[guide].range": (-5.0, 20.0), "body[trigger]/inertial.mass": 1e12}
        free = engine.changed(changes)
        free.push("object_1", force=np.array([0.0, 0.0, -force]))
        free.step(free.whole_steps(PRESSED_S))
        free.push("object_1", force=np.zeros(3))
        free.step(free.whole_steps(5.0))
        return TOP - float(free.pose("object_1").position[2])

    near = theory(knobs)
    first, last = left(0.97 * near), left(1.03 * near)
    return float(near * (0.97 + 0.06 * (SET - first) / (last - first)))


def naive(knobs):
    """The putty's speed at an excess of 0.05 m carried on in proportion; the elastic law alone."""
    even = {**knobs, "oil": 0.3}
    return {
        "elastic": knobs["k"] * SET,
        "in proportion": _force("even", even) if knobs["kind"] != "even" else knobs["k"] * SET,
    }
