"""Scene 212: learn the mass, lead the puck through a current with an eddy, fit each current to the course, predict."""

import numpy as np

from scenes.courses import Laws
from scenes.protocol import answer, call
from scenes.pucks import PuckFloor, force_on_puck

_COMMON = ("m", "shear", "stream", "middle_x", "middle_y", "whirl", "width", "c", "p")
STRUCTURES = {"still": _COMMON, "drifting": (*_COMMON, "drift"), "fading": (*_COMMON, "period")}
BOX = {
    "m": (0.2, 8.0),
    "shear": (-0.4, 0.4),
    "stream": (-0.7, 0.7),
    "middle_x": (0.8, 3.6),
    "middle_y": (-1.8, 1.8),
    "whirl": (-2.4, 2.4),
    "width": (0.4, 2.2),
    "c": (0.4, 3.0),
    "p": (1.1, 2.6),
    "drift": (-0.16, 0.16),
    "period": (9.0, 70.0),
}
FAR_M, WHERE_M, LATE_S, FAST_M_S = 20.0, 3.5, 30.0, 10.0


def _current(structure, knobs, time, x, y):
    """Velocity of what flows at a place and a time."""
    px, py = x - knobs["middle_x"], y - knobs["middle_y"]
    now = knobs["whirl"]
    if structure == "drifting":
        py = py - knobs["drift"] * time
    if structure == "fading":
        now = now * np.exp(-time / knobs["period"])
    turn = 2 * now * knobs["width"] / (px**2 + py**2 + knobs["width"] ** 2)
    return knobs["stream"] + knobs["shear"] * y - turn * py, turn * px


def _drag(structure, knobs, time, state):
    """Force of what flows on the puck, per kilogram."""
    x, y, vx, vy = state
    ux, uy = _current(structure, knobs, time, x, y)
    drag = knobs["c"] * np.sqrt((vx - ux) ** 2 + (vy - uy) ** 2 + 1e-12) ** (knobs["p"] - 1)
    return drag * (ux - vx), drag * (uy - vy)


def _rates(structure, knobs, time, state, force):
    """Time derivative of the state."""
    fx, fy = _drag(structure, knobs, time, state)
    return np.array([state[2], state[3], force[0] / knobs["m"] + fx, force[1] / knobs["m"] + fy])


def predict(structure, knobs):
    """Drift far away; force that holds late; force that leads fast."""
    far = _current(structure, knobs, 0.0, 0.0, FAR_M)
    held = _drag(structure, knobs, LATE_S, (WHERE_M, 0.0, 0.0, 0.0))
    led = _drag(structure, knobs, 0.0, (0.0, 0.0, FAST_M_S, 0.0))
    return [float(far[0]), float(-knobs["m"] * held[1]), float(-knobs["m"] * led[0])]


def measure(engine, knobs):
    """The same from forces on the puck in the engine."""
    velocity = np.zeros(2)
    scale = knobs["m"] * knobs["c"]
    for _ in range(40):
        # The velocity without a force, by steps that a drag of any power makes smaller.
        rest = force_on_puck(engine, (0.0, FAR_M), tuple(velocity))
        size = np.hypot(*rest)
        if size < 1e-7:
            break
        velocity = velocity + rest / size * (size / scale) ** (1 / knobs["p"])
    return [
        float(velocity[0]),
        float(-force_on_puck(engine, (WHERE_M, 0.0), time=LATE_S)[1]),
        float(-force_on_puck(engine, (0.0, 0.0), (FAST_M_S, 0.0))[0]),
    ]


def naive(knobs):
    """The current stays as it is; no current, and a linear drag."""
    drift, _, fast = predict(knobs["kind"], knobs)
    held = _drag("still", knobs, 0.0, (WHERE_M, 0.0, 0.0, 0.0))
    linear = float(knobs["m"] * knobs["c"] * FAST_M_S)
    return {"stays": [drift, float(-knobs["m"] * held[1]), linear], "no current": [0.0, 0.0, fast]}


def stage(task):
    """Wait as the question says; else let it drift."""
    yield [call("step", duration=LATE_S)]
    yield [call("step", duration=1.0)]
    seen = yield [call("get_velocity", object_id="object_1")]
    vx, vy, _ = seen[0]["velocity"]
    yield [answer([vx, -vy, 20.0])]


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(0.0, 0.0, 0.0, 0.0),
    sigma=(0.002, 0.002, 0.005, 0.005),
    longest_s=0.15,
    starts=500,
    tried=4,
    rounds=15,
    hopeless=5.0,
)
FLOOR = PuckFloor(
    laws=LAWS,
    predict=predict,
    targets=((3.0, 1.2), (1.6, -1.5), (3.3, -0.6), (1.0, 2.6), (2.2, -0.5), (3.2, 1.4), (-1.0, -2.6)),
    near_m=1.0,
    safe_m=3.6,
    haste=4.0,
    leg_s=0.9,
    wanders=0.5,
    coasts_s=0.5,
)
solve, batch, fit = FLOOR.solve, FLOOR.batch, FLOOR.fit
