"""Scene 76: balance impulses over many intervals; what the box passes on, against the slip, tells what is in it."""

import numpy as np

from scenes.couples import Couple, off_steady
from scenes.pairs import Tour, states, until_caught, windows
from scenes.protocol import answer

FORCES, BRAKE_N, NET_M = (40.0, 0.0), 1.0, 1.3
SIGMA = 0.00084
"""Standard deviation of a difference of two rounded readings [m, m/s]."""
COUPLE = Couple(
    laws={"dry": ("f2",), "linear": ("c2",), "square": ("q2",)},
    box={
        "n": (0.05, 4.0),
        "m1": (0.05, 60.0),
        "m2": (0.05, 60.0),
        "c1": (0.2, 20.0),
        "f1": (0.0, 3.0),
        "f2": (0.1, 5.0),
        "c2": (0.1, 5.0),
        "q2": (0.1, 5.0),
        "share": (0.05, 1.0),
        "fluid": (0.05, 20.0),
    },
    sigma=SIGMA,
    forces=(5.0, 0.0),
)
TOUR = Tour(
    pairs=[(level, 0.0) for level in (10, 3, 10, 10, 10, 0, 10, 2, 10, 10, 0, 10, 10)],
    times=(4.0, 3.0, 2.4, 2.0, 1.6, 1.3, 1.0, 0.8, 0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.06),
    room=0.9,
    force=10.0,
    sealed=True,
)


def _windows(exchanges):
    return windows(until_caught(states(exchanges), NET_M), slow=0.02, still=0.004, near=0.01)


def predict(structure, knobs):
    """Speeds in the end with the brake."""
    return COUPLE.steady(structure, knobs, FORCES, BRAKE_N)


def rivals(readings):
    """Every coupling with every resistance."""
    return COUPLE.members(_windows(readings), predict)


def fit(readings, structure):
    """Predict with the coupling and the resistance of this structure."""
    return COUPLE.member(structure, _windows(readings), predict).answer


def _best(exchanges):
    return min(rivals(exchanges).values(), key=lambda found: found.chi_square + 4 * found.constants).answer


def solve(task):
    """Push by turns, choosing force and duration from the present motion; then compare all structures."""
    exchanges = yield from TOUR.driven()
    yield [answer(_best(exchanges))]


def batch(task):
    """Pulses fixed in advance, read at their ends."""
    pulses = ((3, 0.4), (10, 0.5), (-10, 0.9), (-10, 0.5), (10, 0.9), (10, 0.4), (-5, 0.6), (10, 0.6), (-10, 1.0))
    plan = [made for force, duration in pulses for made in TOUR.push((force, 0), duration, looks=1)]
    yield [answer(_best(list(zip(plan, (yield plan), strict=True))))]


def stage(task):
    """Push with 40 N; it is refused, and 10 N bring the carts to other speeds."""
    readings = yield [*TOUR.push(FORCES, 0.5, looks=1), *TOUR.push((10, 0), 1.5, looks=1)]
    yield [answer([reading["velocity"][0] for reading in readings if "velocity" in reading][-2:])]


def structure(knobs):
    """What joins the carts, and how object_2 is braked."""
    return f"{knobs['kind']}, {knobs['law']}"


def naive(knobs):
    """The resistance of object_1 alone, and the gear without slip."""
    top = FORCES[0] / knobs["c1"]
    return {"object_2 ignored": [top, knobs["n"] * top]}


def _pushed(engine, knobs, off, seconds):
    """Speeds a while after the carts were set off by this share of the steady speeds, with brake and without nets."""
    free = engine.changed({"joint[x2].frictionloss": knobs["f2"] + BRAKE_N, "body[nets].pos": (1e6, 0.0, 0.0)})
    return off_steady(free, predict(structure(knobs), knobs), FORCES, off, seconds)


def measure(engine, knobs):
    """The engine's own speeds, from near the steady ones on."""
    return _pushed(engine, knobs, -0.1, 60.0)


def settles(engine, knobs, off):
    """The larger difference to the steady speeds, over the larger of these."""
    steady = np.array(predict(structure(knobs), knobs))
    left = np.array(_pushed(engine, knobs, off, 60.0)) - steady
    return float(np.max(np.abs(left)) / np.max(steady))
