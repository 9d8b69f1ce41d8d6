"""Scene 15: send one glider against the other and compare the kinetic energies before and after."""

from math import sqrt

import numpy as np

from scenes.protocol import answer, call

GLIDERS = ("object_1", "object_2")
SPEED = 2.0
OUTCOMES = {
    1: "no kinetic energy is lost",
    2: "some kinetic energy is lost and they part again",
    3: "they stay together",
}
ENERGY_LOSS = 0.02
TOGETHER = 0.1
ELSEWHERE = 0.437
"""Another start, so that the impact falls elsewhere in the time step."""


def _verdict(kept, parting):
    """From the share of energy kept, and of the speed at which they part."""
    if kept > 1 - ENERGY_LOSS:
        return OUTCOMES[1]
    return OUTCOMES[3] if parting < TOGETHER else OUTCOMES[2]


def solve(task):
    """Momentum and energy after the hit give the parting speed: e² = 2 (share of energy kept) - 1 for equal masses."""
    readings = yield [
        call("set_velocity", object_id="object_1", velocity_vector=[SPEED, 0, 0]),
        call("get_kinetic_energy", object_id="object_1", mass=1.0),
        call("step", duration=1.0),
        *(call("get_kinetic_energy", object_id=glider, mass=1.0) for glider in GLIDERS),
    ]
    before, first, second = (readings[index]["kinetic_energy"] for index in (1, 3, 4))
    kept = (first + second) / before
    yield [answer(_verdict(kept, sqrt(max(2 * kept - 1, 0.0))))]


def theory(knobs):
    """The kind that was drawn."""
    return OUTCOMES[knobs["kind"]]


def measure(engine, knobs):
    """The same collision in the engine, from nearer, by the speeds at which they part."""
    engine.place("object_1", np.array([ELSEWHERE, 0.0, 0.5]), {})
    engine.set_velocity("object_1", np.array([SPEED, 0.0, 0.0]))
    engine.step(engine.whole_steps(1.0))
    first, second = (float(engine.twist(glider).linear[0]) for glider in GLIDERS)
    return _verdict((first**2 + second**2) / SPEED**2, (second - first) / SPEED)
