"""Scene 63: the platform's angular speed before and after, as twice its energy over its angular momentum."""

from scipy.optimize import brentq

from scenes.protocol import answer, call

START_R = 0.8
STIFFNESS = 400.0
FIRST_RATE = 1.0
BALL_INERTIA = 0.4 * 0.04**2
"""Of a weight about itself, per kg."""
DRAW_S = 12.0


def _look():
    return [
        call("get_rotational_energy", object_id="object_1", mass=1.0),
        call("get_angular_momentum", object_id="object_1", mass=1.0),
    ]


def _rate(energy, spin):
    return 2 * energy["rotational_energy"] / spin["angular_momentum"]["z"]


def solve(task):
    """With one mass in both, ω = 2 E / L."""
    readings = yield [*_look(), call("step", duration=DRAW_S), *_look()]
    yield [answer(_rate(*readings[3:]) / _rate(*readings[:2]))]


def theory(knobs):
    """Angular momentum stays; at rest on the rail k (r - r0) = m ω² r."""

    def inertia(r):
        return knobs["platform"] + 2 * knobs["m"] * (r**2 + BALL_INERTIA)

    spin = inertia(START_R) * FIRST_RATE

    def outward(r):
        """Force on a weight, as it turns with the platform."""
        return knobs["m"] * (spin / inertia(r)) ** 2 * r - STIFFNESS * (r - knobs["rest"])

    return spin / inertia(brentq(outward, knobs["rest"], START_R)) / FIRST_RATE


def measure(engine, knobs):
    """The platform's own angular speed in the engine."""
    start = float(engine.twist("object_1").angular[2])
    engine.step(engine.whole_steps(2 * DRAW_S))
    return float(engine.twist("object_1").angular[2]) / start
