"""Scene 204: learn mass and drift, lead the puck slowly and fast while it wears, fit each law, predict."""

import numpy as np

from scenes.courses import Laws
from scenes.protocol import answer, call
from scenes.pucks import HEAVY_KG, PuckFloor, force_now, force_on_puck, heavy_puck

_COMMON = ("m", "c", "p", "last", "wear", "side", "drift_x", "drift_y")
STRUCTURES = {"way": _COMMON, "time": _COMMON, "work": _COMMON}
BOX = {
    "m": (0.13, 13.0),
    "c": (0.4, 4.0),
    "p": (1.05, 2.7),
    "last": (0.05, 0.7),
    "wear": (2.5, 20.0),
    "side": (-1.4, 1.4),
    "drift_x": (-1.5, 1.5),
    "drift_y": (-1.5, 1.5),
}
FAST_M_S, SLOW_M_S, LED_M_S, LED_M = 10.0, 1.0, 8.0, 4.0


def _factor(knobs, worn):
    """Share of the fresh drag that is left."""
    return knobs["last"] + (1 - knobs["last"]) * np.exp(-worn / knobs["wear"])


def _wearing(structure, knobs, speed, worn):
    """Rate at which the puck wears at a speed."""
    if structure == "way":
        return speed
    if structure == "time":
        return 1.0 + 0 * speed
    return knobs["c"] * _factor(knobs, worn) * speed ** (knobs["p"] + 1)


def _rates(structure, knobs, time, state, force):
    """Time derivative of the state, which ends with what has worn the puck."""
    _, _, vx, vy, worn = state
    speed = np.sqrt(vx**2 + vy**2 + 1e-12)
    drag = knobs["c"] * _factor(knobs, worn) * speed ** (knobs["p"] - 1)
    turn = knobs["side"]
    return np.array(
        [
            vx,
            vy,
            force[0] / knobs["m"] + knobs["drift_x"] + turn * vy - drag * vx,
            force[1] / knobs["m"] + knobs["drift_y"] - turn * vx - drag * vy,
            _wearing(structure, knobs, speed, worn),
        ]
    )


def predict(structure, knobs):
    """Fresh drag at speed; last drag; drag after some way at speed."""
    m, c, p = knobs["m"], knobs["c"], knobs["p"]
    worn, steps = 0.0, 400
    for _ in range(steps):
        rate = _wearing(structure, knobs, LED_M_S, worn)
        half = worn + rate * LED_M / LED_M_S / steps / 2
        worn += _wearing(structure, knobs, LED_M_S, half) * LED_M / LED_M_S / steps
    return [
        float(m * c * FAST_M_S**p),
        float(m * c * knobs["last"] * SLOW_M_S**p),
        float(m * c * _factor(knobs, worn) * LED_M_S**p),
    ]


def measure(engine, knobs):
    """The same from forces on the puck in the engine."""
    fresh = engine.changed({"joint[worn_x].armature": HEAVY_KG})
    rest, fast = (force_on_puck(fresh, (0.0, 0.0), (speed, 0.0))[0] for speed in (0.0, FAST_M_S))
    forces = [rest - fast]
    for speed, worn, lasting in ((SLOW_M_S, 1e3, 0.0), (LED_M_S, 0.0, LED_M / LED_M_S)):
        heavy = heavy_puck(engine)
        heavy.set_velocity("object_1", np.array([speed, 0.0, 0.0]))
        heavy.set_velocity("worn", np.array([worn, 0.0, 0.0]))
        heavy.step(heavy.whole_steps(lasting))
        forces.append(rest - force_now(heavy)[0])
    return [float(force) for force in forces]


def naive(knobs):
    """It does not wear; or it wears with the time, and the drag is linear."""
    fast, _, _ = predict(knobs["kind"], knobs)
    fresh = knobs["m"] * knobs["c"]
    return {
        "no wear": [fast, fresh * SLOW_M_S ** knobs["p"], fresh * LED_M_S ** knobs["p"]],
        "linear": [fresh * FAST_M_S, fresh * knobs["last"], fresh * LED_M_S],
    }


def stage(task):
    """Push hard; else push twice and compare."""
    yield [call("apply_force", object_id="object_1", force_vector=[100, 0, 0]), call("step", duration=1)]
    yield [call("apply_force", object_id="object_1", force_vector=[2, 0, 0]), call("step", duration=1)]
    seen = yield [call("get_velocity", object_id="object_1")]
    speed = float(np.hypot(*seen[0]["velocity"][:2]))
    yield [answer([2 * 10 / speed, 2 / speed, 2 * 8 / speed])]


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(0.0, 0.0, 0.0, 0.0, 0.0),
    sigma=(0.003, 0.003, 0.007, 0.007),
    longest_s=0.25,
    starts=500,
    tried=4,
    rounds=15,
)
FLOOR = PuckFloor(
    laws=LAWS,
    predict=predict,
    targets=((2.4, 0.6), (-2.3, -0.7), (0.3, 2.3), (0.4, -2.4)),
    near_m=0.8,
    safe_m=2.4,
    haste=4.5,
    lightest_kg=0.25,
    heaviest_kg=6.0,
    leg_s=1.2,
    slowed=0.65,
    coasts_s=0.5,
    rim_m=3.0,
    drifts=True,
    idle_legs=1,
)
solve, batch, fit = FLOOR.solve, FLOOR.batch, FLOOR.fit
