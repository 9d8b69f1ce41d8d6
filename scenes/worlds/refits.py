"""Fits other structures to the readings of a sampled world, for its certificates.

The readings are fitted leg by leg around the path of the true law (`scenes.worlds.weak_form`): to first order this
equals a fit to all legs in sequence, in a fraction of its time.
"""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from scenes.course_record import Course
from scenes.family import largest_excess
from scenes.fitting import Array, refined
from scenes.worlds.candidates import Fit, expected_gain
from scenes.worlds.course_fits import fit_at
from scenes.worlds.experiment import SEARCH_S, Situation, retraced, traced
from scenes.worlds.search import Search
from scenes.worlds.terms import Structure
from scenes.worlds.weak_form import Legs, named, to_unit

WORSE = 1.5
"""Mean square of the misfits, in variances of a reading, above which a fit does not explain the readings."""
_SMOOTHED = 2
"""Number of times that the path is smoothed with the drawn law before other structures are fitted."""
_ROUNDS = 6
_FIRST_ROUNDS, _LAST_ROUNDS = 2, 14
"""Iterations of the first fit of a similar law, and of each further one."""
_FAR = 200.0
"""Expected excess of chi-square over that of a law that is not excluded, above which a fit is not continued."""
_WALL = 100.0
"""Penalty of a constant outside its range, in standard deviations, per relative distance from the range."""
_CONVERGED = 0.1
"""Expected decrease of chi-square below which a fit has converged."""
_CONTINUED, _STARTS = 3, 3
"""Largest number of further fits of a similar law from the result of the last one, then from random constants."""


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

    def fit_similar(self) -> list[Fit]:
        """Fit the true law, and all that differ from it by one part; returns the true law first.

        A part is a form, alone or with one modulation, or a modulation. Constants outside the ranges of the grammar are
        penalised. If the misfits were linear in the constants, a fit could be extrapolated to its minimum. Fits whose
        extrapolation cannot explain the readings are ended early. If a fit does not explain the readings, although an
        extrapolation does, it is continued, then repeated from random constants of the new term.
        """
        rng, found = np.random.default_rng(0), dict[Structure, Fit]()

        def fit(structure: Structure, unit: Array, rounds: int) -> Fit:
            misfits = partial(self._restricted, structure)
            fit = fit_at(structure, refined(misfits, unit, rounds), misfits)
            if structure not in found or fit.chi_square < found[structure].chi_square:
                found[structure] = fit
            return found[structure]

        with np.errstate(all="ignore"):
            drawn = fit(self.drawn.structure, self.drawn.unit, _ROUNDS)
            for structure, unit in self.search.all_neighbours(self.drawn):
                fit(structure, unit, _FIRST_ROUNDS)
            for first in list(found.values())[1:]:
                structure, new = first.structure, self._new(first.structure)
                limit = drawn.chi_square + largest_excess(len(drawn.unit) - len(first.unit))
                gain = expected_gain(first)
                hoped = first.chi_square - gain
                if hoped > limit + _FAR or (first.chi_square <= limit and gain < _CONVERGED):
                    continue
                near, others = first, rng.random((_STARTS if new.any() else 0, len(new)))
                for start in [*[None] * _CONTINUED, *others]:
                    unit = near.unit if start is None else np.where(new, start, near.unit)
                    near = fit(structure, unit, _LAST_ROUNDS)
                    hoped = min(hoped, near.chi_square - expected_gain(near))
                    if not hoped <= limit < near.chi_square:
                        break
        return list(found.values())

    def _restricted(self, structure: Structure, units: Array) -> Array:
        """Return whitened misfits, and penalties for constants that are not in the ranges of the grammar."""
        values = named(structure, units)
        beyond = [bounds.beyond(values[name]) for name, bounds in structure.ranges.items()]
        return np.vstack([self.search.whitened.misfits(structure, units), _WALL * np.vstack(beyond)])

    def _new(self, structure: Structure) -> NDArray[np.bool_]:
        """Return which constants belong to terms that the true law does not have."""
        terms = self.drawn.structure.terms
        sizes = [(term not in terms, len(term.ranges(0))) for term in structure.terms]
        return np.repeat([False, *(new for new, _ in sizes)], [structure.bodies, *(size for _, size in sizes)])

    def unexplained(self, structure: Structure, constants: Mapping[str, float]) -> bool:
        """Return whether a structure with these constants does not explain the readings."""
        return not float((retraced(structure, constants, self.told, self.course) ** 2).mean()) < WORSE


def units_of(structure: Structure, constants: Mapping[str, float]) -> Array:
    """Return the point of the unit cube at which the constants have these values."""
    return np.array([float(to_unit(bounds, constants[name])) for name, bounds in structure.ranges.items()])


def constants_of(fit: Fit) -> dict[str, float]:
    """The constants of a fit."""
    return {name: float(value) for name, value in named(fit.structure, fit.unit).items()}
