"""Scene 208: learn the mass, lead the puck round an unseen thing that moves, fit each law, predict."""

import numpy as np

from scenes.courses import Laws
from scenes.protocol import answer, call
from scenes.pucks import PuckFloor, force_now, force_on_puck, heavy_puck

_COMMON = ("m", "c", "p", "home_x", "home_y", "pull", "n", "haste", "lag")
STRUCTURES = {"comes": _COMMON, "shuns": _COMMON, "rounds": _COMMON}
BOX = {
    "m": (0.2, 8.0),
    "c": (0.3, 2.2),
    "p": (1.1, 2.5),
    "home_x": (0.8, 2.9),
    "home_y": (-2.1, 2.1),
    "pull": (-2.2, 2.2),
    "n": (0.2, 1.6),
    "haste": (0.6, 3.0),
    "lag": (0.9, 4.5),
}
HELD_M, FAR_M, FAST_M_S = 5.0, 12.0, 7.0
CORE_M2, SCALE_M = 0.64, 2.0
HEAVY_KG = 1e9


def _drawn(knobs, px, py):
    """Force of the thing per kilogram on a puck from which it lies as given."""
    r = np.sqrt(px**2 + py**2 + CORE_M2)
    drawn = knobs["pull"] * (SCALE_M / r) ** knobs["n"] / r
    return drawn * px, drawn * py


def _answers(structure, knobs, x, y, ax, ay):
    """Velocity of the thing, which is away from home as given."""
    dx, dy = x - knobs["home_x"] - ax, y - knobs["home_y"] - ay
    felt = knobs["haste"] * 2 / (dx**2 + dy**2 + 1)
    tx, ty = {"comes": (dx, dy), "shuns": (-dx, -dy), "rounds": (-dy, dx)}[structure]
    return felt * tx - ax / knobs["lag"], felt * ty - ay / knobs["lag"]


def _rates(structure, knobs, time, state, force):
    """Time derivative of the state, which ends with how far the thing is from home."""
    x, y, vx, vy, ax, ay = state
    fx, fy = _drawn(knobs, knobs["home_x"] + ax - x, knobs["home_y"] + ay - y)
    drag = knobs["c"] * np.sqrt(vx**2 + vy**2 + 1e-12) ** (knobs["p"] - 1)
    tx, ty = _answers(structure, knobs, x, y, ax, ay)
    return np.array([vx, vy, force[0] / knobs["m"] + fx - drag * vx, force[1] / knobs["m"] + fy - drag * vy, tx, ty])


def predict(structure, knobs):
    """Holding force in the end; holding force far away at the start; resistance at speed."""
    m, h = knobs["m"], 0.05
    ax = ay = 0.0
    for _ in range(1600):
        tx, ty = _answers(structure, knobs, HELD_M, 0.0, ax, ay)
        tx, ty = _answers(structure, knobs, HELD_M, 0.0, ax + h / 2 * tx, ay + h / 2 * ty)
        ax, ay = ax + h * tx, ay + h * ty
    late = _drawn(knobs, knobs["home_x"] + ax - HELD_M, knobs["home_y"] + ay)[0]
    early = _drawn(knobs, knobs["home_x"] + FAR_M, knobs["home_y"])[0]
    return [float(-m * late), float(-m * early), float(m * knobs["c"] * FAST_M_S ** knobs["p"])]


def measure(engine, knobs):
    """The same from forces on the puck in the engine."""
    heavy = heavy_puck(engine, HEAVY_KG)
    heavy.place("object_1", np.array([HELD_M, 0.0, 0.05]), {})
    heavy.step(heavy.whole_steps(60.0))
    late = force_now(heavy, HEAVY_KG)[0]
    rest, fast = (force_on_puck(engine, (0.0, 0.0), (0.0, speed)) for speed in (0.0, FAST_M_S))
    return [float(-late), float(-force_on_puck(engine, (-FAR_M, 0.0))[0]), float(rest[1] - fast[1])]


def naive(knobs):
    """The thing stays at home; nothing is there, and the drag is linear."""
    _, early, fast = predict(knobs["kind"], knobs)
    m = knobs["m"]
    stays = float(-m * _drawn(knobs, knobs["home_x"] - HELD_M, knobs["home_y"])[0])
    return {"stays": [stays, early, fast], "linear": [stays, early, float(m * knobs["c"] * FAST_M_S)]}


def stage(task):
    """Push hard; else wait and hold against the first force."""
    yield [call("apply_force", object_id="object_1", force_vector=[100, 0, 0]), call("step", duration=1)]
    yield [call("step", duration=0.5)]
    seen = yield [call("get_velocity", object_id="object_1")]
    vx, vy, _ = seen[0]["velocity"]
    yield [answer([-vx, -vy, 40.0])]


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    sigma=(0.0045, 0.0045, 0.0115, 0.0115),
    longest_s=0.15,
    starts=150,
    tried=2,
    rounds=10,
)
FLOOR = PuckFloor(
    laws=LAWS,
    predict=predict,
    targets=((3.4, 0.4), (1.6, 2.4), (-2.6, -0.4), (1.8, -2.4), (0.4, 0.3), (3.2, -0.8), (0.2, 2.4)),
    near_m=0.9,
    safe_m=3.5,
    haste=4.0,
    leg_s=0.9,
    slowed=0.6,
    coasts_s=0.5,
)
solve, batch, fit = FLOOR.solve, FLOOR.batch, FLOOR.fit
