"""Scene 215: learn the mass, lead the puck about an unseen wave, fit each sort of wave to the course, predict."""

import numpy as np

from scenes.courses import Laws
from scenes.protocol import answer, call
from scenes.pucks import HEAVY_KG, PuckFloor, force_on_puck, heavy_puck

_COMMON = ("m", "c", "p", "size", "to", "length", "period", "phase")
STRUCTURES = {
    "runs": (*_COMMON, "angle"),
    "stands": (*_COMMON, "angle", "shift"),
    "rings": (*_COMMON, "middle_x", "middle_y"),
}
BOX = {
    "m": (0.2, 8.0),
    "c": (0.25, 2.5),
    "p": (1.15, 2.4),
    "size": (0.5, 2.6),
    "to": (-0.4, 3.6),
    "length": (3.6, 9.0),
    "period": (3.6, 9.0),
    "phase": (-0.5, 6.8),
    "angle": (-0.5, 6.8),
    "shift": (-0.4, 3.6),
    "middle_x": (0.4, 2.8),
    "middle_y": (-2.4, 2.4),
}
HELD, HELD_S, FAR, FAST_M_S = (6.0, 0.0), 24.0, (-6.0, 4.0), 14.0


def _wave(structure, knobs, time, x, y):
    """Force of the wave per kilogram along its direction."""
    turned = 2 * np.pi * time / knobs["period"] + knobs["phase"]
    number = 2 * np.pi / knobs["length"]
    if structure == "rings":
        r = np.sqrt((x - knobs["middle_x"]) ** 2 + (y - knobs["middle_y"]) ** 2 + 0.04)
        return knobs["size"] * np.sin(turned - number * r)
    along = x * np.cos(knobs["angle"]) + y * np.sin(knobs["angle"])
    if structure == "runs":
        return knobs["size"] * np.sin(turned - number * along)
    return knobs["size"] * np.sin(turned) * np.cos(number * along + knobs["shift"])


def _rates(structure, knobs, time, state, force):
    """Time derivative of the state."""
    x, y, vx, vy = state
    pushed = _wave(structure, knobs, time, x, y)
    drag = knobs["c"] * np.sqrt(vx**2 + vy**2 + 1e-12) ** (knobs["p"] - 1)
    return np.array(
        [
            vx,
            vy,
            force[0] / knobs["m"] + pushed * np.cos(knobs["to"]) - drag * vx,
            force[1] / knobs["m"] + pushed * np.sin(knobs["to"]) - drag * vy,
        ]
    )


def predict(structure, knobs):
    """Holding force late; greatest holding force elsewhere; resistance at speed."""
    m, times = knobs["m"], np.linspace(0, knobs["period"], 721)
    return [
        float(-m * _wave(structure, knobs, HELD_S, *HELD) * np.cos(knobs["to"])),
        float(m * np.max(np.abs(_wave(structure, knobs, times, *FAR)))),
        float(m * knobs["c"] * FAST_M_S ** knobs["p"]),
    ]


def measure(engine, knobs):
    """The same from forces on the puck in the engine."""
    heavy = heavy_puck(engine)
    heavy.place("object_1", np.array([*FAR, 0.05]), {})
    before, forces = np.zeros(2), []
    for _ in range(heavy.whole_steps(knobs["period"])):
        heavy.step(1)
        after = heavy.twist("object_1").linear[:2]
        forces.append(np.hypot(*(after - before)) * HEAVY_KG / heavy.timestep)
        before = after
    rest, fast = (force_on_puck(engine, (0.0, 0.0), (0.0, speed)) for speed in (0.0, FAST_M_S))
    return [float(-force_on_puck(engine, HELD, time=HELD_S)[0]), float(max(forces)), float(rest[1] - fast[1])]


def naive(knobs):
    """The same everywhere; the same at all times."""
    _, _, fast = predict(knobs["kind"], knobs)
    m, kind = knobs["m"], knobs["kind"]
    here = float(-m * _wave(kind, knobs, HELD_S, 0.0, 0.0) * np.cos(knobs["to"]))
    now = float(-m * _wave(kind, knobs, 0.0, *HELD) * np.cos(knobs["to"]))
    linear = m * knobs["c"] * FAST_M_S
    return {"same everywhere": [here, m * knobs["size"], linear], "always the same": [now, abs(now), fast]}


def stage(task):
    """Wait as the question says; else hold against the first force."""
    yield [call("step", duration=HELD_S)]
    yield [call("step", duration=0.5)]
    seen = yield [call("get_velocity", object_id="object_1")]
    vx, vy, _ = seen[0]["velocity"]
    yield [answer([-vx, abs(vx) + abs(vy), 40.0])]


LAWS = Laws(
    rates=_rates,
    structures=STRUCTURES,
    box=BOX,
    start=(0.0, 0.0, 0.0, 0.0),
    sigma=(0.004, 0.004, 0.01, 0.01),
    longest_s=0.25,
    starts=3000,
    tried=16,
    rounds=15,
)
FLOOR = PuckFloor(
    laws=LAWS,
    predict=predict,
    targets=((3.2, 1.0), (-2.6, 1.9), (2.2, -2.4), (-3.0, -0.3), (1.0, 2.8), (3.2, -0.8), (-2.0, 2.4)),
    near_m=1.0,
    safe_m=3.6,
    haste=3.2,
    leg_s=1.0,
    wanders=0.5,
    patience=3,
    rim_m=4.3,
    coasts_s=0.6,
)
solve, batch, fit = FLOOR.solve, FLOOR.batch, FLOOR.fit
