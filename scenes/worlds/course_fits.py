"""Fits of a structure to all legs of an experiment in sequence, from the result of a fit leg by leg."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from scenes.course_record import Course
from scenes.fitting import Array, refined
from scenes.worlds.candidates import Fit, score_of
from scenes.worlds.experiment import COURSE_S, Situation, course_misfits, laws_of_fit
from scenes.worlds.terms import Structure
from scenes.worlds.weak_form import box_of

_ROUNDS = 4
_SHIFT = 1e-4


def on_course(course: Course, told: Situation, fit: Fit, longest_s: float = COURSE_S) -> Fit:
    """Return a fit to all legs in sequence, integrated from the initial state."""
    structure = fit.structure
    box = {name: box_of(bounds) for name, bounds in structure.ranges.items()}
    laws = replace(laws_of_fit(structure, told, longest_s), box=box)

    def misfits(units: Array) -> Array:
        return course_misfits(structure, told, laws, course, units)

    return fit_at(structure, refined(misfits, fit.unit, _ROUNDS), misfits)


def fit_at(structure: Structure, unit: Array, misfits: Callable[[Array], Array]) -> Fit:
    """Return the fit object of a structure at given constants, without optimising them.

    Args:
        structure: The terms of the law.
        unit: Point of the unit cube.
        misfits: Points of the unit cube, a column for each → whitened misfits.
    """
    around = misfits(unit[:, None] + _SHIFT * np.column_stack([np.zeros(len(unit)), np.eye(len(unit))]))
    own, slope = around[:, 0], (around[:, 1:] - around[:, :1]) / _SHIFT
    return Fit(structure, unit, float(own @ own), score_of(structure, own, slope), own, slope)
