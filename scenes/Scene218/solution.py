"""Scene 218: learn the mass, lead the puck round an unseen centre whose field changes, fit each law, predict."""

import numpy as np

from scenes.courses import Laws
from scenes.protocol import answer, call
from scenes.pucks import PuckFloor, force_on_puck

_COMMON = ("m", "middle_x", "middle_y", "whirl", "width", "pull", "core", "c", "p", "period")
STRUCTURES = {"fading": _COMMON, "growing": _COMMON, "swinging": (*_COMMON, "phase")}
BOX = {
    "m": (0.2, 8.0),
    "middle_x": (0.8, 3.6),
    "middle_y": (-2.4, 2.4),
    "whirl": (-2.5, 2.5),
    "width": (0.4, 3.0),
    "pull": (-2.0, 2.0),
    "core": (0.25, 2.4),
    "c": (0.25, 2.5),
    "p": (1.1, 2.6),
    "period": (9.0, 40.0),
    "phase": (-0.5, 6.8),
}
FAR_M, LATE_S, FAST_M_S = 9.0, 32.0, 12.0


def _strength(structure, knobs, time):
    """Factor of the whirl at a time."""
    if structure == "fading":
        return np.exp(-time / knobs["period"])
    if structure == "growing":
        return 1 + time / knobs["period"]
    return np.cos(2 * np.pi * time / knobs["period"] + knobs["phase"])


def _field(structure, knobs, time, x, y):
    """Force per kilogram on the puck at rest: round the centre and towards it."""
    px, py = x - knobs["middle_x"], y - knobs["middle_y"]
    r = np.sqrt(px**2 + py**2 + 1e-6)
    round_it = _strength(structure, knobs, time) * 2 * knobs["whirl"] * knobs["width"] / (r**2 + knobs["width"] ** 2)
    to_it = knobs["pull"] * np.tanh(r / knobs["core"]) / r
    return -round_it * py - to_it * px, round_it * px - to_it * py


def _rates(structure, knobs, time, state, force):
    """Time derivative of the state."""
    x, y, vx, vy = state
    fx, fy = _field(structure, knobs, time, x, y)
    drag = knobs["c"] * np.sqrt(vx**2 + vy**2 + 1e-12) ** (knobs["p"] - 1)
    return np.array([vx, vy, force[0] / knobs["m"] + fx - drag * vx, force[1] / knobs["m"] + fy - drag * vy])


def predict(structure, knobs):
    """Holding force along y late and far away; along x early and far away; resistance to a fast motion."""
    late, early = (_field(structure, knobs, time, -FAR_M, 0.0) for time in (LATE_S, 0.0))
    m = knobs["m"]
    return [float(-m * late[1]), float(-m * early[0]), float(m * knobs["c"] * FAST_M_S ** knobs["p"])]


def measure(engine, knobs):
    """The same from forces on the puck in the engine."""
    rest, fast = (force_on_puck(engine, (0.0, 0.0), (0.0, speed)) for speed in (0.0, FAST_M_S))
    return [
        float(-force_on_puck(engine, (-FAR_M, 0.0), time=LATE_S)[1]),
        float(-force_on_puck(engine, (-FAR_M, 0.0))[0]),
        float(rest[1] - fast[1]),
    ]


def naive(knobs):
    """The field as at the start at all times; resistance in proportion to the speed."""
    _, early, fast = predict(knobs["kind"], knobs)
    now = float(-knobs["m"] * _field(knobs["kind"], knobs, 0.0, -FAR_M, 0.0)[1])
    return {"always the same": [now, early, fast], "linear": [now, early, float(knobs["m"] * knobs["c"] * FAST_M_S)]}


def stage(task):
    """Wait as the question says; else hold against the first force."""
    yield [call("step", duration=LATE_S)]
    yield [call("step", duration=0.5)]
    seen = yield [call("get_velocity", object_id="object_1")]
    vx, vy, _ = seen[0]["velocity"]
    yield [answer([-vy, -vx, 20.0])]


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(0.0, 0.0, 0.0, 0.0),
    sigma=(0.003, 0.003, 0.007, 0.007),
    longest_s=0.12,
    starts=500,
    tried=4,
    rounds=15,
)
FLOOR = PuckFloor(
    laws=LAWS,
    predict=predict,
    targets=((3.0, 0.8), (1.8, -2.3), (-2.7, -0.3), (1.0, 2.3), (2.0, 0.0), (2.7, -1.3), (-1.0, 1.9)),
    near_m=1.0,
    safe_m=3.2,
    haste=4.0,
    leg_s=0.9,
    slowed=0.6,
    coasts_s=0.6,
)
solve, batch, fit = FLOOR.solve, FLOOR.batch, FLOOR.fit
