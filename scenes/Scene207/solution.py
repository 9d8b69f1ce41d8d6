"""Scene 207: learn the mass, lead the puck to and fro in a field that answers late, fit each field, predict."""

import numpy as np

from scenes.courses import Laws
from scenes.protocol import answer, call
from scenes.pucks import PuckFloor, force_now, force_on_puck, heavy_puck

_COMMON = ("m", "c", "p", "lag")
_PLACE = ("home_x", "home_y", "pull", "n")
STRUCTURES = {"draws": (*_COMMON, *_PLACE), "rounds": (*_COMMON, *_PLACE), "saddle": (*_COMMON, "steep", "angle")}
BOX = {
    "m": (0.2, 8.0),
    "c": (0.35, 2.4),
    "p": (1.1, 2.5),
    "lag": (0.4, 2.6),
    "home_x": (0.6, 3.0),
    "home_y": (-2.2, 2.2),
    "pull": (-2.2, 2.2),
    "n": (0.05, 1.0),
    "steep": (0.15, 1.0),
    "angle": (-0.4, 3.6),
}
HELD_M, LED_M_S, FAST_M_S = 8.0, 6.0, 10.0
SCALE_M, CORE_M2 = 2.0, 0.09


def _field(structure, knobs, x, y):
    """Force of the field at a place, per kilogram."""
    if structure == "saddle":
        cos, sin = np.cos(2 * knobs["angle"]), np.sin(2 * knobs["angle"])
        return knobs["steep"] * (x * cos + y * sin), knobs["steep"] * (x * sin - y * cos)
    px, py = x - knobs["home_x"], y - knobs["home_y"]
    r = np.sqrt(px**2 + py**2 + CORE_M2)
    field = knobs["pull"] * (r / SCALE_M) ** knobs["n"] / r
    return (-field * px, -field * py) if structure == "draws" else (-field * py, field * px)


def _rates(structure, knobs, time, state, force):
    """Time derivative of the state, which ends with the place that follows."""
    x, y, vx, vy, past_x, past_y = state
    fx, fy = _field(structure, knobs, past_x, past_y)
    drag, m, lag = knobs["c"] * np.sqrt(vx**2 + vy**2 + 1e-12) ** (knobs["p"] - 1), knobs["m"], knobs["lag"]
    return np.array(
        [vx, vy, force[0] / m + fx - drag * vx, force[1] / m + fy - drag * vy, (x - past_x) / lag, (y - past_y) / lag]
    )


def predict(structure, knobs):
    """Holding force in the end; force across a steady motion; resistance at speed."""
    m = knobs["m"]
    return [
        float(-m * _field(structure, knobs, HELD_M, 0.0)[0]),
        float(-m * _field(structure, knobs, 0.0, -LED_M_S * knobs["lag"])[0]),
        float(m * knobs["c"] * FAST_M_S ** knobs["p"]),
    ]


def measure(engine, knobs):
    """The same from forces on the puck in the engine."""
    forces = []
    for place, speed, lasting in ((HELD_M, 0.0, 25.0), (0.0, LED_M_S, 25.0)):
        heavy = heavy_puck(engine)
        heavy.place("object_1", np.array([place, -speed * lasting, 0.05]), {})
        heavy.set_velocity("object_1", np.array([0.0, speed, 0.0]))
        heavy.step(heavy.whole_steps(lasting))
        forces.append(force_now(heavy)[0])
    rest, fast = (force_on_puck(engine, (0.0, 0.0), (0.0, speed)) for speed in (0.0, FAST_M_S))
    return [float(-forces[0]), float(-forces[1]), float(rest[1] - fast[1])]


def naive(knobs):
    """The field acts where the puck is; a field as at the start, and a linear drag."""
    held, _, fast = predict(knobs["kind"], knobs)
    m = knobs["m"]
    here = float(-m * _field(knobs["kind"], knobs, 0.0, 0.0)[0])
    return {"at once": [held, here, fast], "linear": [held, here, m * knobs["c"] * FAST_M_S]}


def stage(task):
    """Push hard; else wait and hold against the first force."""
    yield [call("apply_force", object_id="object_1", force_vector=[100, 0, 0]), call("step", duration=1)]
    yield [call("step", duration=0.5)]
    seen = yield [call("get_velocity", object_id="object_1")]
    vx, vy, _ = seen[0]["velocity"]
    yield [answer([-vx - 0.1, -vy - 0.1, 40.0])]


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    sigma=(0.005, 0.005, 0.0125, 0.0125),
    longest_s=0.25,
    starts=250,
    tried=3,
    rounds=12,
)
FLOOR = PuckFloor(
    laws=LAWS,
    predict=predict,
    targets=((3.2, 0.4), (-0.6, 2.8), (-2.8, -0.6), (1.2, -2.8), (2.6, 1.6), (-2.0, 1.8)),
    near_m=0.9,
    safe_m=3.3,
    haste=4.0,
    leg_s=0.9,
    slowed=0.5,
    coasts_s=0.5,
)
solve, batch, fit = FLOOR.solve, FLOOR.batch, FLOOR.fit
