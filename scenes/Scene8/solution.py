"""Scene 8: let both balls roll; the share of energy in the spin tells what each of them is."""

from math import sqrt

import numpy as np

from scenes.protocol import answer, call

BALLS = ("object_1", "object_2")
ROLL_S = 1.0
SOLID, THIN = 2 / 5, 2 / 3
"""I / m r² of either kind; without slipping, also rotational over translational energy."""


def _verdict(first, second):
    """From I / m r² of both balls: the only thin-walled one, or 0."""
    thin = [share > sqrt(SOLID * THIN) for share in (first, second)]
    if thin[0] == thin[1]:
        return "0"
    return BALLS[0] if thin[0] else BALLS[1]


def solve(task):
    """One second; then I / m r² = rotational / translational energy, for which any mass serves."""
    readings = yield [
        call("step", duration=ROLL_S),
        *(call("get_rotational_energy", object_id=ball, mass=1.0) for ball in BALLS),
        *(call("get_kinetic_energy", object_id=ball, mass=1.0) for ball in BALLS),
    ]
    spin = [reading["rotational_energy"] for reading in readings[1:3]]
    motion = [reading["kinetic_energy"] for reading in readings[3:5]]
    yield [answer(_verdict(spin[0] / motion[0], spin[1] / motion[1]))]


def theory(knobs):
    """The ball that was drawn."""
    return f"object_{knobs['which']}" if knobs["which"] else "0"


def measure(engine, knobs):
    """From the distances s in the engine: s = g sin θ t² / 2 (1 + I / m r²)."""
    start = [engine.pose(ball).position for ball in BALLS]
    engine.step(engine.whole_steps(ROLL_S))
    free = 9.81 * np.sin(np.radians(20)) * ROLL_S**2 / 2
    runs = (np.linalg.norm(engine.pose(ball).position - place) for ball, place in zip(BALLS, start, strict=True))
    return _verdict(*(float(free / run - 1) for run in runs))
