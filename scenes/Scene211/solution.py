"""Scene 211: learn the mass, lead the puck round both hidden places, fit each pair of laws to the course, predict."""

import numpy as np

from scenes.courses import Laws
from scenes.protocol import answer, call
from scenes.pucks import PuckFloor, force_on_puck

_COMMON = ("m", "c", "p", "first_x", "first_y", "pull", "n", "second_x", "second_y", "reach")
STRUCTURES = {"draws": (*_COMMON, "other"), "round": (*_COMMON, "other"), "brakes": (*_COMMON, "much")}
BOX = {
    "m": (0.2, 8.0),
    "c": (0.25, 2.6),
    "p": (1.1, 2.6),
    "first_x": (0.8, 3.4),
    "first_y": (-2.6, 2.6),
    "pull": (-2.8, 2.8),
    "n": (0.1, 2.0),
    "second_x": (-3.4, -0.8),
    "second_y": (-1.2, 2.0),
    "other": (-3.5, 3.5),
    "much": (0.5, 4.0),
    "reach": (0.6, 2.4),
}
HELD_M, PLACE, FAST_M_S = 14.0, (-2.0, -1.0), 8.0
SCALE_M, CORE_M2 = 2.0, 0.25


def _acting(structure, knobs, x, y, vx, vy):
    """Force on the puck per kilogram."""
    px, py = x - knobs["first_x"], y - knobs["first_y"]
    r = np.sqrt(px**2 + py**2 + CORE_M2)
    drawn = knobs["pull"] * (SCALE_M / r) ** knobs["n"] / r
    qx, qy = x - knobs["second_x"], y - knobs["second_y"]
    near = np.exp(-(qx**2 + qy**2) / (2 * knobs["reach"] ** 2))
    drag = knobs["c"] * np.sqrt(vx**2 + vy**2 + 1e-12) ** (knobs["p"] - 1)
    if structure == "brakes":
        drag = drag + knobs["much"] * near
        fx, fy = 0.0, 0.0
    else:
        felt = knobs["other"] * near * 1.6487 / knobs["reach"]
        fx, fy = (-felt * qx, -felt * qy) if structure == "draws" else (-felt * qy, felt * qx)
    return fx - drawn * px - drag * vx, fy - drawn * py - drag * vy


def _rates(structure, knobs, time, state, force):
    """Time derivative of the state."""
    x, y, vx, vy = state
    fx, fy = _acting(structure, knobs, x, y, vx, vy)
    return np.array([vx, vy, force[0] / knobs["m"] + fx, force[1] / knobs["m"] + fy])


def predict(structure, knobs):
    """Holding force far away; force that leads through a place at speed, across and along."""
    m = knobs["m"]
    along, across = _acting(structure, knobs, *PLACE, FAST_M_S, 0.0)
    return [float(-m * _acting(structure, knobs, HELD_M, 0.0, 0.0, 0.0)[0]), float(-m * across), float(-m * along)]


def measure(engine, knobs):
    """The same from forces on the puck in the engine."""
    along, across = force_on_puck(engine, PLACE, (FAST_M_S, 0.0))
    return [float(-force_on_puck(engine, (HELD_M, 0.0))[0]), float(-across), float(-along)]


def naive(knobs):
    """One place alone, with a force that falls with the square; or none, and a linear drag."""
    _, across, along = predict(knobs["kind"], knobs)
    square = knobs["m"] * knobs["pull"] * (SCALE_M / HELD_M) ** 2
    return {"one place": [square, across, along], "drag alone": [0.0, 0.0, knobs["m"] * knobs["c"] * FAST_M_S]}


def stage(task):
    """Push hard; else push once and compare."""
    yield [call("apply_force", object_id="object_1", force_vector=[100, 0, 0]), call("step", duration=1)]
    yield [call("apply_force", object_id="object_1", force_vector=[2, 0, 0]), call("step", duration=1)]
    seen = yield [call("get_velocity", object_id="object_1")]
    vx, vy, _ = seen[0]["velocity"]
    yield [answer([2 - vx, -vy, 16.0])]


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(0.0, 0.0, 0.0, 0.0),
    sigma=(0.003, 0.003, 0.007, 0.007),
    longest_s=0.25,
    starts=500,
    tried=4,
    rounds=15,
)
FLOOR = PuckFloor(
    laws=LAWS,
    predict=predict,
    targets=((-1.2, 0.8), (-3.2, 0.2), (-1.6, -1.4), (3.3, -0.3), (2.0, 2.6), (-2.2, 1.8), (1.0, -2.6)),
    near_m=0.9,
    safe_m=3.7,
    haste=3.2,
    leg_s=0.8,
    slowed=0.65,
    coasts_s=0.6,
    patience=3,
)
solve, batch, fit = FLOOR.solve, FLOOR.batch, FLOOR.fit
