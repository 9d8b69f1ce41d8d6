"""Scene 220: learn the mass, lead the puck about while two laws take turns, fit each pair of laws, predict."""

import numpy as np

from scenes.courses import Laws
from scenes.protocol import answer, call
from scenes.pucks import PuckFloor, force_now, heavy_puck

_COMMON = ("m", "period", "phase_midway", "middle_x", "middle_y", "pull", "n", "c", "p")
STRUCTURES = {"wind": (*_COMMON, "wind_x", "wind_y"), "turn": (*_COMMON, "turn"), "brake": (*_COMMON, "brake")}
BOX = {
    "m": (0.08, 20.0),
    "period": (2.7, 7.8),
    "phase_midway": (-3.2, 9.5),
    "middle_x": (1.2, 3.2),
    "middle_y": (-2.0, 2.0),
    "pull": (-2.0, 2.0),
    "n": (0.15, 1.1),
    "c": (0.4, 1.8),
    "p": (1.15, 2.3),
    "wind_x": (-1.8, 1.8),
    "wind_y": (-1.8, 1.8),
    "turn": (-2.6, 2.6),
    "brake": (0.7, 3.2),
}
ROUNDS_ASKED, FAR_M, FAST_M_S = 50, 12.0, 20.0
SCALE_M, BLUR = 2.0, 0.3
MIDWAY_S = 9.5


def _turns(knobs, time):
    """Share of the first law at a time."""
    phase = 2 * np.pi * (time - MIDWAY_S) / knobs["period"] + knobs["phase_midway"]
    return 0.5 + 0.5 * np.tanh(np.sin(phase) / BLUR)


def _drawn(knobs, x, y):
    """Force of the first law per kilogram on a puck at a place."""
    px, py = x - knobs["middle_x"], y - knobs["middle_y"]
    r = np.sqrt(px**2 + py**2 + 1e-2)
    size = knobs["pull"] * (r / SCALE_M) ** knobs["n"] / r
    return -size * px, -size * py


def _other(structure, knobs, vx, vy):
    """Force of the second law per kilogram on a puck with a velocity."""
    if structure == "wind":
        return knobs["wind_x"], knobs["wind_y"]
    if structure == "turn":
        return knobs["turn"] * vy, -knobs["turn"] * vx
    return -knobs["brake"] * vx, -knobs["brake"] * vy


def _rates(structure, knobs, time, state, force):
    """Time derivative of the state."""
    x, y, vx, vy = state
    share, drawn, other = _turns(knobs, time), _drawn(knobs, x, y), _other(structure, knobs, vx, vy)
    drag = knobs["c"] * np.sqrt(vx**2 + vy**2 + 1e-12) ** (knobs["p"] - 1)
    return np.array(
        [
            vx,
            vy,
            force[0] / knobs["m"] + share * drawn[0] + (1 - share) * other[0] - drag * vx,
            force[1] / knobs["m"] + share * drawn[1] + (1 - share) * other[1] - drag * vy,
        ]
    )


def predict(structure, knobs):
    """Time of many rounds; mean holding force far away; greatest resistance to a fast motion."""
    mean = (_drawn(knobs, -FAR_M, 0.0)[0] + _other(structure, knobs, 0.0, 0.0)[0]) / 2
    rest, fast = (_other(structure, knobs, 0.0, speed) for speed in (0.0, FAST_M_S))
    resisting = knobs["c"] * FAST_M_S ** knobs["p"]
    greatest = np.hypot(fast[0] - rest[0], fast[1] - rest[1] - resisting)
    return [float(ROUNDS_ASKED * knobs["period"]), float(-knobs["m"] * mean), float(knobs["m"] * greatest)]


def measure(engine, knobs):
    """The round's time is what it is; the forces during one round in the engine, in three situations by turns."""
    heavy = heavy_puck(engine)
    forces = []
    for step in range(round(knobs["period"] / heavy.timestep)):
        heavy.place("object_1", np.array([-FAR_M if step % 3 == 0 else 0.0, 0.0, 0.05]), {})
        heavy.set_velocity("object_1", np.array([0.0, FAST_M_S if step % 3 == 2 else 0.0, 0.0]))
        forces.append(force_now(heavy))
    held, rest, fast = (np.array(forces[first : len(forces) // 3 * 3 : 3]) for first in range(3))
    greatest = np.hypot(*(fast - rest).T).max()
    return [float(ROUNDS_ASKED * knobs["period"]), float(-held[:, 0].mean()), float(greatest)]


def naive(knobs):
    """The first law all the time; resistance in proportion to the speed."""
    rounds, _, _ = predict(knobs["kind"], knobs)
    first = float(-knobs["m"] * _drawn(knobs, -FAR_M, 0.0)[0])
    return {
        "always the same": [rounds, first, float(knobs["m"] * knobs["c"] * FAST_M_S ** knobs["p"])],
        "linear": [rounds, first / 2, float(knobs["m"] * knobs["c"] * FAST_M_S)],
    }


def stage(task):
    """Wait for as many rounds; else read the first seconds."""
    yield [call("step", duration=30.0), call("step", duration=100.0)]
    seen = yield [call("get_velocity", object_id="object_1")]
    yield [answer([200.0, -float(seen[0]["velocity"][0]), 25.0])]


def _laws(box):
    """The laws with a range for each constant."""
    return Laws(
        rates=_rates,
        structures=STRUCTURES,
        box=box,
        start=(0.0, 0.0, 0.0, 0.0),
        sigma=(0.0035, 0.0035, 0.0085, 0.0085),
        longest_s=0.13,
        starts=2000,
        tried=8,
        rounds=14,
    )


class Floor(PuckFloor):
    """Looks for the mass only near its first estimate."""

    def best(self, readings):
        """The answer of the structure that fits best."""
        return self._near(readings).best(readings)

    def fit(self, readings, structure):
        """The answer of the best fit of a structure."""
        return self._near(readings).fit(readings, structure)

    def _near(self, readings):
        mass = self.mass(readings)
        return PuckFloor(laws=_laws({**BOX, "m": (mass / 1.5, 1.5 * mass)}), **LEADING)


LEADING = {
    "predict": predict,
    "targets": ((3.5, 0.5), (1.0, -2.0), (-3.3, -0.6), (1.4, 1.8), (3.4, -1.0), (-2.5, 1.4)),
    "near_m": 1.0,
    "safe_m": 3.5,
    "haste": 4.5,
    "lightest_kg": 0.06,
    "heaviest_kg": 14.0,
    "leg_s": 1.0,
    "slowed": 0.6,
    "coasts_s": 0.6,
}
FLOOR = Floor(laws=_laws(BOX), **LEADING)
solve, batch, fit = FLOOR.solve, FLOOR.batch, FLOOR.fit
