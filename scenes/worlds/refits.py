"""Fits of other structures to the readings of a drawn world, which its certificates ask for.

The readings are fitted leg by leg about the path of the drawn law (`scenes.worlds.weak_form`): to first order that is a
fit of the whole course, at a small part of its time.
"""

from collections.abc import Mapping

import numpy as np

from scenes.fitting import Array
from scenes.worlds.candidates import Fit
from scenes.worlds.experiment import Situation, retraced, simulated
from scenes.worlds.search import Search
from scenes.worlds.terms import Structure
from scenes.worlds.weak_form import Legs, named, to_unit

WORSE = 1.5
"""Mean square of the misfits, in variances of a reading, from which on a fit does not explain the readings."""
_SMOOTHED = 2
"""How often the path is smoothed by the drawn law before others are fitted."""
_ROUNDS = 6


class Refits:
    """The readings of a drawn world, to which structures are fitted.

    Attributes:
        course: What was held and read.
        drawn: The fit of the drawn structure.
    """

    def __init__(self, structure: Structure, constants: Mapping[str, float], told: Situation, noise_seed: int) -> None:
        self.told, self.course = told, simulated(structure, constants, told, noise_seed)
        unit, legs = units_of(structure, constants), Legs.of(self.course, told)
        with np.errstate(all="ignore"):
            for _ in range(_SMOOTHED):
                legs = legs.about(structure, unit).smoothed(structure, unit)
            self.search = Search(legs, about=(structure, unit))
            self.drawn = self.search.fit(structure, unit, _ROUNDS)

    def fitted(self, structure: Structure, constants: Mapping[str, float]) -> Fit:
        """The fit of a structure from constants."""
        return self.search.fit(structure, units_of(structure, constants), _ROUNDS)

    def unexplained(self, structure: Structure, constants: Mapping[str, float]) -> bool:
        """Whether a structure with these constants leaves the readings of the course unexplained."""
        return not float((retraced(structure, constants, self.told, self.course) ** 2).mean()) < WORSE


def units_of(structure: Structure, constants: Mapping[str, float]) -> Array:
    """The point of the unit cube at which the constants have these values."""
    return np.array([float(to_unit(bounds, constants[name])) for name, bounds in structure.ranges.items()])


def constants_of(fit: Fit) -> dict[str, float]:
    """The constants of a fit."""
    return {name: float(value) for name, value in named(fit.structure, fit.unit).items()}
