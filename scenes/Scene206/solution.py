"""Scene 206: learn the mass, lead the puck while the uniform force changes, fit each law to the course, predict."""

import numpy as np

from scenes.courses import Laws
from scenes.protocol import answer, call
from scenes.pucks import PuckFloor, force_on_puck

_COMMON = ("m", "c", "p", "tilt", "angle")
STRUCTURES = {
    "turning": (*_COMMON, "rate"),
    "fading": (*_COMMON, "lasting"),
    "pulsing": (*_COMMON, "period", "depth", "phase"),
}
BOX = {
    "m": (0.3, 5.0),
    "c": (0.2, 3.0),
    "p": (1.1, 2.8),
    "tilt": (0.25, 2.5),
    "angle": (-0.4, 6.7),
    "period": (7.0, 45.0),
    "lasting": (9.0, 70.0),
    "rate": (-0.8, 0.8),
    "depth": (0.2, 1.3),
    "phase": (-0.4, 6.7),
}
LATE_S, FAST_M_S, LONG_S = 35.0, 25.0, 60.0
HEAVY_KG = 1e6


def _tilt(structure, knobs, time):
    """Uniform force per kilogram at a time."""
    size, angle = knobs["tilt"], knobs["angle"]
    if structure == "turning":
        angle = angle + knobs["rate"] * time
    elif structure == "fading":
        size = size * np.exp(-time / knobs["lasting"])
    else:
        size = size * (1 + knobs["depth"] * np.sin(2 * np.pi * time / knobs["period"] + knobs["phase"]))
    return size * np.cos(angle), size * np.sin(angle)


def _rates(structure, knobs, time, state, force):
    """Time derivative of the state."""
    _, _, vx, vy = state
    ax, ay = _tilt(structure, knobs, time)
    drag = knobs["c"] * np.sqrt(vx**2 + vy**2 + 1e-12) ** (knobs["p"] - 1)
    return np.array([vx, vy, force[0] / knobs["m"] + ax - drag * vx, force[1] / knobs["m"] + ay - drag * vy])


def predict(structure, knobs):
    """Holding force late; resistance at speed; momentum given by the hand that holds."""
    times = np.linspace(0, LONG_S, 2001)
    held = knobs["m"] * (_tilt(structure, knobs, times)[1] + 0 * times)
    return [
        float(-knobs["m"] * _tilt(structure, knobs, LATE_S)[0]),
        float(knobs["m"] * knobs["c"] * FAST_M_S ** knobs["p"]),
        float(-np.sum(held[1:] + held[:-1]) / 2 * (times[1] - times[0])),
    ]


def measure(engine, knobs):
    """The same from forces on the puck in the engine."""
    heavy = engine.changed({"joint[object_1_x].armature": HEAVY_KG, "joint[object_1_y].armature": HEAVY_KG})
    heavy.step(heavy.whole_steps(LONG_S))
    return [
        float(-force_on_puck(engine, (0.0, 0.0), time=LATE_S)[0]),
        float((force_on_puck(engine, (0.0, 0.0)) - force_on_puck(engine, (0.0, 0.0), (FAST_M_S, 0.0)))[0]),
        float(-heavy.twist("object_1").linear[1] * HEAVY_KG),
    ]


def naive(knobs):
    """As at the start at all times; resistance in proportion to the speed."""
    late, fast, momentum = predict(knobs["kind"], knobs)
    ax, ay = (float(part) for part in _tilt(knobs["kind"], knobs, 0.0))
    return {
        "always the same": [-knobs["m"] * ax, fast, -knobs["m"] * ay * LONG_S],
        "linear": [late, knobs["m"] * knobs["c"] * FAST_M_S, momentum],
    }


def stage(task):
    """Wait as the question says; else hold against the first force."""
    yield [call("step", duration=LATE_S)]
    yield [call("step", duration=1.0)]
    seen = yield [call("get_velocity", object_id="object_1")]
    vx, vy, _ = seen[0]["velocity"]
    yield [answer([-vx, 100.0, -vy * LONG_S])]


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(0.0, 0.0, 0.0, 0.0),
    sigma=(0.005, 0.005, 0.012, 0.012),
    longest_s=0.25,
    starts=500,
    tried=4,
    rounds=15,
)
FLOOR = PuckFloor(
    laws=LAWS,
    predict=predict,
    targets=((4.0, 1.5), (-3.5, -1.5), (0.5, 4.0), (1.0, -4.0)),
    near_m=1.2,
    safe_m=5.0,
    haste=3.9,
    leg_s=1.38,
    slowed=0.75,
    coasts_s=0.7,
    fixed_pushes=(
        (0.6, 0.0, 1.4),
        (-1.2, 0.5, 1.4),
        (2.5, -0.5, 1.4),
        (-4.0, 0.5, 1.4),
        (5.0, 0.0, 1.2),
        (-6.0, 2.0, 1.2),
        (0.0, 0.0, 2.0),
        (4.0, -4.0, 2.0),
    ),
    lightest_kg=0.4,
    heaviest_kg=4.0,
)
solve, batch, fit = FLOOR.solve, FLOOR.batch, FLOOR.fit
