"""Scene 209: learn the mass, lead the puck in many directions, fit each law to the course, predict."""

import numpy as np

from scenes.courses import Laws
from scenes.protocol import answer, call
from scenes.pucks import PuckFloor, force_on_puck

_COMMON = ("m", "c", "p")
STRUCTURES = {
    "to": (*_COMMON, "bias", "middle_x", "middle_y"),
    "round": (*_COMMON, "bias", "middle_x", "middle_y"),
    "turning": (*_COMMON, "more", "angle", "twist"),
}
BOX = {
    "m": (0.06, 30.0),
    "c": (0.2, 2.0),
    "p": (1.1, 2.7),
    "more": (0.7, 7.0),
    "bias": (-7.0, 7.0),
    "middle_x": (0.4, 3.6),
    "middle_y": (-3.0, 3.0),
    "angle": (-0.5, 6.8),
    "twist": (-0.8, 0.8),
}
FAR_M, SLOW_M_S, FAST_M_S = 8.0, 2.0, 8.0
CORE_M = 0.4


def _drag(structure, knobs, x, y, vx, vy):
    """Drag over the velocity, per kilogram."""
    if structure == "turning":
        angle = knobs["angle"] + knobs["twist"] * x
        ex, ey, more = np.cos(angle), np.sin(angle), knobs["more"]
    else:
        px, py = x - knobs["middle_x"], y - knobs["middle_y"]
        r = np.sqrt(px**2 + py**2 + CORE_M**2)
        sense, more = np.sign(knobs["bias"]), np.abs(knobs["bias"])
        ex, ey = (-sense * px / r, -sense * py / r) if structure == "to" else (-sense * py / r, sense * px / r)
    speed = np.sqrt(vx**2 + vy**2 + 1e-12)
    favour = 0.5 + 0.5 * (vx * ex + vy * ey) / speed
    return knobs["c"] * speed ** (knobs["p"] - 1) * (1 + more * favour**2)


def _rates(structure, knobs, time, state, force):
    """Time derivative of the state."""
    x, y, vx, vy = state
    drag = _drag(structure, knobs, x, y, vx, vy)
    return np.array([vx, vy, force[0] / knobs["m"] - drag * vx, force[1] / knobs["m"] - drag * vy])


def predict(structure, knobs):
    """Resistance far away in two directions; least resistance at speed."""
    m = knobs["m"]
    return [
        float(m * _drag(structure, knobs, FAR_M, 0.0, 0.0, SLOW_M_S) * SLOW_M_S),
        float(m * _drag(structure, knobs, FAR_M, 0.0, 0.0, -SLOW_M_S) * SLOW_M_S),
        float(m * knobs["c"] * FAST_M_S ** knobs["p"]),
    ]


def measure(engine, knobs):
    """The same from forces on the puck in the engine."""
    ways = [2 * np.pi * way / 48 for way in range(48)]
    fast = [
        -force_on_puck(engine, (0.0, 0.0), (FAST_M_S * np.cos(way), FAST_M_S * np.sin(way)))
        @ (np.cos(way), np.sin(way))
        for way in ways
    ]
    return [
        float(-force_on_puck(engine, (FAR_M, 0.0), (0.0, SLOW_M_S))[1]),
        float(force_on_puck(engine, (FAR_M, 0.0), (0.0, -SLOW_M_S))[1]),
        float(min(fast)),
    ]


def naive(knobs):
    """The same resistance in all directions, as to a motion along x at the origin; in proportion to the speed."""
    there, back, fast = predict(knobs["kind"], knobs)
    here = float(knobs["m"] * _drag(knobs["kind"], knobs, 0.0, 0.0, SLOW_M_S, 0.0) * SLOW_M_S)
    return {"all directions": [here, here, fast], "linear": [there, back, knobs["m"] * knobs["c"] * FAST_M_S]}


def stage(task):
    """Push hard; else push once and compare."""
    yield [call("apply_force", object_id="object_1", force_vector=[0, 100, 0]), call("step", duration=1)]
    yield [call("apply_force", object_id="object_1", force_vector=[0, 2, 0]), call("step", duration=1)]
    seen = yield [call("get_velocity", object_id="object_1")]
    speed = float(np.hypot(*seen[0]["velocity"][:2]))
    yield [answer([2 / speed, 2 / speed, 30 / speed])]


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(0.0, 0.0, 0.0, 0.0),
    sigma=(0.0035, 0.0035, 0.0085, 0.0085),
    longest_s=0.1,
    starts=500,
    tried=4,
    rounds=20,
)
FLOOR = PuckFloor(
    laws=LAWS,
    predict=predict,
    targets=((3.2, 0.3), (0.5, -2.8), (0.3, 2.8), (3.0, 1.2), (-1.5, -0.5), (2.5, -1.8), (1.6, 2.6)),
    near_m=0.9,
    safe_m=3.4,
    haste=4.2,
    lightest_kg=0.05,
    heaviest_kg=20.0,
    leg_s=0.8,
    slowed=0.55,
    coasts_s=0.5,
)
solve, batch, fit = FLOOR.solve, FLOOR.batch, FLOOR.fit
