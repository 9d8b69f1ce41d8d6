"""Scene 214: learn the mass, lead the puck in many directions, fit each law of the grain, predict."""

import numpy as np

from scenes.courses import Laws
from scenes.protocol import answer, call
from scenes.pucks import PuckFloor, force_now, force_on_puck, heavy_puck

_COMMON = ("m", "c", "p", "more", "angle", "turn")
STRUCTURES = {"time": _COMMON, "place": _COMMON, "way": _COMMON}
BOX = {
    "m": (0.06, 30.0),
    "c": (0.25, 2.2),
    "p": (1.1, 2.5),
    "more": (0.6, 5.0),
    "angle": (-1.6, 4.8),
    "turn": (-2.2, 2.2),
}
USUAL = {"time": 0.2, "place": 0.4, "way": 0.15}
A_M, A_M_S, B_M, B_M_S, FAST_M_S = 8.0, 2.0, 20.0, 1.0, 15.0


def _resisted(knobs, turned, vx, vy):
    """Force of the floor per kilogram on a puck with a velocity, where its direction has turned by an angle."""
    ex, ey = np.cos(knobs["angle"] + turned), np.sin(knobs["angle"] + turned)
    drag = knobs["c"] * np.sqrt(vx**2 + vy**2 + 1e-12) ** (knobs["p"] - 1)
    along = knobs["more"] * (vx * ex + vy * ey)
    return -drag * (vx + along * ex), -drag * (vy + along * ey)


def _rates(structure, knobs, time, state, force):
    """Time derivative of the state, which ends with the way gone."""
    x, _, vx, vy, gone = state
    turned = knobs["turn"] * USUAL[structure] * {"time": time, "place": x, "way": gone}[structure]
    fx, fy = _resisted(knobs, turned, vx, vy)
    speed = np.sqrt(vx**2 + vy**2 + 1e-12)
    return np.array([vx, vy, force[0] / knobs["m"] + fx, force[1] / knobs["m"] + fy, speed])


def predict(structure, knobs):
    """Forces across the motion after a way, and along a fast motion."""
    m, turn = knobs["m"], knobs["turn"] * USUAL[structure]
    first = turn * {"time": A_M / A_M_S, "place": A_M, "way": A_M}[structure]
    second = turn * {"time": B_M / B_M_S, "place": 0.0, "way": B_M}[structure]
    return [
        float(-m * _resisted(knobs, first, A_M_S, 0.0)[1]),
        float(-m * _resisted(knobs, second, 0.0, B_M_S)[0]),
        float(-m * _resisted(knobs, 0.0, FAST_M_S, 0.0)[0]),
    ]


def measure(engine, knobs):
    """The same in the engine, with a puck too heavy to be stopped."""
    forces = []
    for speed, way in (((A_M_S, 0.0), A_M), ((0.0, B_M_S), B_M)):
        heavy = heavy_puck(engine)
        heavy.set_velocity("object_1", np.array([*speed, 0.0]))
        heavy.step(heavy.whole_steps(way / max(speed)))
        forces.append(force_now(heavy))
    fast = force_on_puck(engine, (0.0, 0.0), (FAST_M_S, 0.0))
    return [float(-forces[0][1]), float(-forces[1][0]), float(-fast[0])]


def naive(knobs):
    """The direction does not turn; or it turns with the time."""
    fixed = {**knobs, "turn": 0.0}
    still = predict("time", fixed)
    linear = -knobs["m"] * _resisted({**knobs, "p": 1.0}, 0.0, FAST_M_S, 0.0)[0]
    return {"does not turn": still, "no direction": [0.0, 0.0, float(linear)]}


def stage(task):
    """Push hard; else push once and compare."""
    yield [call("apply_force", object_id="object_1", force_vector=[100, 0, 0]), call("step", duration=1)]
    yield [call("apply_force", object_id="object_1", force_vector=[2, 0, 0]), call("step", duration=1)]
    seen = yield [call("get_velocity", object_id="object_1")]
    vx, vy, _ = seen[0]["velocity"]
    yield [answer([-2 * vy, -vy, 30 / max(vx, 0.01)])]


def _laws(box):
    """The laws with a range for each constant."""
    return Laws(
        rates=_rates,
        structures=STRUCTURES,
        box=box,
        start=(0.0, 0.0, 0.0, 0.0, 0.0),
        sigma=(0.0045, 0.0045, 0.012, 0.012),
        longest_s=0.12,
        starts=700,
        tried=3,
        rounds=15,
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
        return PuckFloor(laws=_laws({**BOX, "m": (mass / 2, 2 * mass)}), **LEADING)


LEADING = {
    "predict": predict,
    "targets": ((2.7, 0.6), (-2.4, -0.9), (0.3, 2.7), (2.2, -1.6), (-2.0, 1.8), (0.4, -2.6)),
    "near_m": 0.9,
    "safe_m": 2.9,
    "haste": 4.0,
    "lightest_kg": 0.05,
    "heaviest_kg": 20.0,
    "leg_s": 0.9,
    "slowed": 0.5,
    "coasts_s": 0.5,
}
FLOOR = Floor(laws=_laws(BOX), **LEADING)
solve, batch, fit = FLOOR.solve, FLOOR.batch, FLOOR.fit
