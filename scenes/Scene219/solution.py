"""Scene 219: learn the mass, lead the puck to and fro over the floor, fit each law of the leash, predict."""

import numpy as np

from scenes.courses import Laws
from scenes.protocol import answer, call
from scenes.pucks import PuckFloor, force_now, force_on_puck, heavy_puck

_COMMON = ("m", "c", "p", "q", "slack", "follow")
STRUCTURES = {"back": (*_COMMON, "k"), "aside": (*_COMMON, "turn"), "grips": (*_COMMON, "k", "grip")}
BOX = {
    "m": (0.02, 60.0),
    "c": (0.25, 2.2),
    "p": (1.1, 2.5),
    "k": (0.8, 4.5),
    "turn": (-4.5, 4.5),
    "q": (0.5, 2.0),
    "slack": (1.2, 2.6),
    "follow": (1.0, 5.5),
    "grip": (0.2, 1.0),
}
LED_M_S, HELD_S, FAST_M_S = 5.0, 5.0, 10.0
BLUR_M = 0.01


def _soft(beyond):
    """Length by which something is exceeded; 0 below, with a smooth bend."""
    return 0.5 * (beyond + np.sqrt(beyond**2 + BLUR_M**2))


def _dragged(structure, knobs, distance):
    """Speed of the anchor towards the puck at a distance."""
    held = knobs["grip"] if structure == "grips" else 0.0
    return knobs["follow"] * _soft(distance - knobs["slack"] - held)


def _rates(structure, knobs, time, state, force):
    """Time derivative of the state, which ends with the place of the anchor."""
    x, y, vx, vy, ax, ay = state
    dx, dy = x - ax, y - ay
    d = np.sqrt(dx**2 + dy**2 + 1e-4)
    size = knobs["turn" if structure == "aside" else "k"] * _soft(d - knobs["slack"]) ** knobs["q"] / d
    fx, fy = (-size * dy, size * dx) if structure == "aside" else (-size * dx, -size * dy)
    drag = knobs["c"] * np.sqrt(vx**2 + vy**2 + 1e-12) ** (knobs["p"] - 1)
    rate = _dragged(structure, knobs, d) / d
    m = knobs["m"]
    return np.array([vx, vy, force[0] / m + fx - drag * vx, force[1] / m + fy - drag * vy, rate * dx, rate * dy])


def predict(structure, knobs):
    """Steady force of the hand that leads; way back to the end of the slack; force on a fresh start."""
    m, q = knobs["m"], knobs["q"]
    k = abs(knobs["turn"]) if structure == "aside" else knobs["k"]
    low, high = 0.0, 200.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if _dragged(structure, knobs, middle) < LED_M_S else (low, middle)
    drag, pull = knobs["c"] * LED_M_S ** knobs["p"], k * _soft(low - knobs["slack"]) ** q
    steady = np.hypot(drag, pull) if structure == "aside" else drag + pull
    distance, h = low, HELD_S / 400
    for _ in range(400):
        distance -= h * _dragged(structure, knobs, distance - h / 2 * _dragged(structure, knobs, distance))
    fast = knobs["c"] * FAST_M_S ** knobs["p"]
    return [float(m * steady), float(distance + knobs["slack"]), float(m * fast)]


def measure(engine, knobs):
    """The same in the engine, with a puck too heavy to be stopped; the anchor keeps its place as a velocity."""
    heavy = heavy_puck(engine)
    heavy.set_velocity("object_1", np.array([LED_M_S, 0.0, 0.0]))
    heavy.step(heavy.whole_steps(15.0))
    steady = np.hypot(*force_now(heavy))
    heavy.set_velocity("object_1", np.zeros(3))
    heavy.step(heavy.whole_steps(HELD_S))
    distance = heavy.pose("object_1").position[0] - heavy.twist("anchor").linear[0]
    fast = force_on_puck(engine, (0.0, 0.0), (FAST_M_S, 0.0))
    return [float(steady), float(distance + knobs["slack"]), float(-fast[0])]


def naive(knobs):
    """No past: nothing but the resistance, and a quiet stretch without length; a leash that is fixed at its end."""
    m, p = knobs["m"], knobs["p"]
    led, _, fast = predict(knobs["kind"], knobs)
    return {"no past": [m * knobs["c"] * LED_M_S**p, 0.0, fast], "one slack": [led, knobs["slack"], fast]}


def stage(task):
    """Push as hard as one can, stop and look."""
    yield [call("apply_force", object_id="object_1", force_vector=[60, 0, 0]), call("step", duration=1)]
    yield [call("apply_force", object_id="object_1", force_vector=[3, 0, 0]), call("step", duration=1)]
    yield [call("apply_force", object_id="object_1", force_vector=[0, 0, 0]), call("step", duration=1)]
    seen = yield [call("get_velocity", object_id="object_1")]
    speed = float(np.hypot(*seen[0]["velocity"][:2]))
    yield [answer([20.0 * speed, 2.0 * speed, 40.0 * speed])]


def _laws(box):
    """The laws with a range for each constant."""
    return Laws(
        rates=_rates,
        structures=STRUCTURES,
        box=box,
        start=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
        sigma=(0.00085, 0.00085, 0.002, 0.002),
        longest_s=0.1,
        starts=250,
        tried=3,
        rounds=12,
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
        mass = 1 / max(self.local(readings).lightness, 1 / self.heaviest_kg)
        return PuckFloor(laws=_laws({**BOX, "m": (mass / 1.6, 1.6 * mass)}), **LEADING)


LEADING = {
    "predict": predict,
    "targets": ((3.2, 0.5), (-3.1, -0.6), (0.4, 3.2), (0.6, -3.2)),
    "near_m": 0.9,
    "safe_m": 3.4,
    "lightest_kg": 0.03,
    "heaviest_kg": 40.0,
    "haste": 4.8,
    "leg_s": 1.0,
    "wanders": 0.5,
    "coasts_s": 0.4,
}
FLOOR = Floor(laws=_laws(BOX), **LEADING)
solve, batch, fit = FLOOR.solve, FLOOR.batch, FLOOR.fit
