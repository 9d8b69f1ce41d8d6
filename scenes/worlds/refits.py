"""Fits other structures to the readings of a sampled world, for its certificates.

The readings are fitted leg by leg around the path of the true law (`scenes.worlds.weak_form`): to first order this
equals a fit to all legs in sequence, in a fraction of its time.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from scenes.course_record import Course
from scenes.fitting import Array
from scenes.worlds.candidates import Fit
from scenes.worlds.experiment import SEARCH_S, Situation, retraced, traced
from scenes.worlds.search import Search
from scenes.worlds.terms import Structure
from scenes.worlds.weak_form import Legs, named, to_unit

WORSE = 1.5
"""Mean square of the misfits, in variances of a reading, above which a fit does not explain the readings."""
_SMOOTHED = 2
"""Number of times that the path is smoothed with the drawn law before other structures are fitted."""
_ROUNDS = 6


class Refits:
    """The readings of a sampled world, to which structures are fitted.

    Attributes:
        course: Pushes and readings. Readings that were not made (NaN) are replaced by those of the true law, with a
            standard deviation so large that they contain no information.
        drawn: The fit of the true structure.
    """

    def __init__(self, structure: Structure, constants: Mapping[str, float], told: Situation, course: Course) -> None:
        unread = np.isnan(course.readings)
        if unread.any():
            true = traced(structure, constants, course.durations, course.controls, SEARCH_S)
            true = true + (told.errors_at(constants, np.cumsum(course.durations)) if told.errors else 0.0)
            course = replace(course, readings=np.where(unread, true, course.readings))
        self.told, self.course = told, course
        unit, legs = units_of(structure, constants), replace(Legs.of(course, told), unread=unread)
        with np.errstate(all="ignore"):
            for _ in range(_SMOOTHED):
                legs = legs.about(structure, unit).smoothed(structure, unit)
            self.search = Search(legs, about=(structure, unit))
            self.drawn = self.search.fit(structure, unit, _ROUNDS)

    def fitted(self, structure: Structure, constants: Mapping[str, float]) -> Fit:
        """Fit a structure, starting from constants."""
        return self.search.fit(structure, units_of(structure, constants), _ROUNDS)

    def unexplained(self, structure: Structure, constants: Mapping[str, float]) -> bool:
        """Return whether a structure with these constants does not explain the readings."""
        return not float((retraced(structure, constants, self.told, self.course) ** 2).mean()) < WORSE


def units_of(structure: Structure, constants: Mapping[str, float]) -> Array:
    """Return the point of the unit cube at which the constants have these values."""
    return np.array([float(to_unit(bounds, constants[name])) for name, bounds in structure.ranges.items()])


def constants_of(fit: Fit) -> dict[str, float]:
    """The constants of a fit."""
    return {name: float(value) for name, value in named(fit.structure, fit.unit).items()}
