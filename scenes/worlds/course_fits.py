"""Fits of a structure to all legs of an experiment in sequence, from the result of a fit leg by leg."""

from dataclasses import replace

import numpy as np

from scenes.course_record import Course
from scenes.fitting import Array, refined
from scenes.worlds.candidates import Fit, score_of
from scenes.worlds.experiment import COURSE_S, Situation, course_misfits, laws_of_fit
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

    unit = refined(misfits, fit.unit, _ROUNDS)
    around = misfits(unit[:, None] + _SHIFT * np.column_stack([np.zeros(len(unit)), np.eye(len(unit))]))
    slope = (around[:, 1:] - around[:, :1]) / _SHIFT
    score = score_of(structure, around[:, 0], slope)
    return Fit(structure, unit, float(around[:, 0] @ around[:, 0]), score, around[:, 0], slope)
