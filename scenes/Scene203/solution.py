"""Scene 203: learn the mass and the drift, lead the puck to and fro, fit laws with a memory to the course, predict."""

import numpy as np

from scenes.courses import Laws
from scenes.protocol import answer, call
from scenes.pucks import PuckFloor, force_now, force_on_puck, heavy_puck

_COMMON = ("m", "c", "p", "q", "lag", "drift_x", "drift_y")
STRUCTURES = {
    "against": (*_COMMON, "k"),
    "along": (*_COMMON, "k"),
    "aside": (*_COMMON, "turn"),
}
BOX = {
    "m": (0.2, 8.0),
    "c": (0.25, 3.0),
    "p": (1.1, 2.8),
    "k": (0.25, 2.5),
    "q": (0.4, 1.9),
    "lag": (0.6, 8.0),
    "turn": (-2.0, 2.0),
    "drift_x": (-2.0, 2.0),
    "drift_y": (-2.0, 2.0),
}
FAST_M_S, LED_M_S, LATER_S = 15.0, 3.0, 2.5


def _rates(structure, knobs, time, state, force):
    """Time derivative of the state, which ends with the velocity that is remembered."""
    _, _, vx, vy, ux, uy = state
    drag = knobs["c"] * np.sqrt(vx**2 + vy**2 + 1e-12) ** (knobs["p"] - 1)
    size = np.sqrt(ux**2 + uy**2 + 1e-8) ** (knobs["q"] - 1)
    if structure == "aside":
        fx, fy = -knobs["turn"] * size * uy, knobs["turn"] * size * ux
    else:
        sign = knobs["k"] if structure == "along" else -knobs["k"]
        fx, fy = sign * size * ux, sign * size * uy
    return np.array(
        [
            vx,
            vy,
            force[0] / knobs["m"] + knobs["drift_x"] + fx - drag * vx,
            force[1] / knobs["m"] + knobs["drift_y"] + fy - drag * vy,
            (vx - ux) / knobs["lag"],
            (vy - uy) / knobs["lag"],
        ]
    )


def predict(structure, knobs):
    """Resistance at speed without a past; force of the past right after a stop, and later."""
    stopped = knobs["m"] * (abs(knobs["turn"]) if structure == "aside" else knobs["k"]) * LED_M_S ** knobs["q"]
    return [
        float(knobs["m"] * (knobs["c"] * FAST_M_S ** knobs["p"] - knobs["drift_x"])),
        float(stopped),
        float(stopped * np.exp(-knobs["q"] * LATER_S / knobs["lag"])),
    ]


def measure(engine, knobs):
    """The same from forces on the puck in the engine."""
    rest, fast = (force_on_puck(engine, (0.0, 0.0), (speed, 0.0)) for speed in (0.0, FAST_M_S))
    heavy = heavy_puck(engine)
    heavy.set_velocity("object_1", np.array([LED_M_S, 0.0, 0.0]))
    heavy.step(heavy.whole_steps(8 * knobs["lag"]))
    heavy.set_velocity("object_1", np.zeros(3))
    held = []
    for lasting in (0.0, LATER_S - heavy.timestep):
        heavy.step(heavy.whole_steps(lasting))
        held.append(float(np.hypot(*(force_now(heavy) - rest))))
    return [float(-fast[0]), *held]


def naive(knobs):
    """No past: what is held feels nothing; resistance in proportion to the speed."""
    fast, stopped, _ = predict(knobs["kind"], knobs)
    return {"no past": [fast, 0.0, 0.0], "forgets nothing": [fast, stopped, stopped]}


def stage(task):
    """Push as hard as one can, stop and look."""
    yield [call("apply_force", object_id="object_1", force_vector=[60, 0, 0]), call("step", duration=1)]
    yield [call("apply_force", object_id="object_1", force_vector=[3, 0, 0]), call("step", duration=1)]
    yield [call("apply_force", object_id="object_1", force_vector=[0, 0, 0]), call("step", duration=1)]
    seen = yield [call("get_velocity", object_id="object_1")]
    speed = float(np.hypot(*seen[0]["velocity"][:2]))
    yield [answer([60.0 * speed, 6.0 * speed, 1.0 * speed])]


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    sigma=(0.0006, 0.0006, 0.00125, 0.00125),
    longest_s=0.25,
    starts=500,
    tried=4,
    rounds=15,
)
FLOOR = PuckFloor(
    laws=LAWS,
    predict=predict,
    targets=((1.6, 0.6), (-1.5, -0.7), (0.3, 1.6), (0.4, -1.7)),
    near_m=0.6,
    safe_m=2.1,
    haste=4.0,
    leg_s=1.3,
    slowed=0.75,
    coasts_s=0.7,
    heaviest_kg=4.5,
    rim_m=2.7,
    drifts=True,
    idle_legs=1,
    growth=20.0,
)
solve, batch, fit = FLOOR.solve, FLOOR.batch, FLOOR.fit
