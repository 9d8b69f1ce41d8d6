"""Tests whether readings distinguish the options of a `which` question."""

import random
from collections.abc import Mapping

import numpy as np

from scenes.courses import Course
from scenes.fitting import Array, refined
from scenes.worlds.catalogue import FORMS, MODULATIONS
from scenes.worlds.drawing import draw_constants
from scenes.worlds.experiment import Situation, laws_of_fit, on_unit
from scenes.worlds.questions import Question
from scenes.worlds.terms import Structure, Term

WORSE = 1.5
"""Mean square of the misfits, in variances of a reading, from which on a fit does not explain the readings."""
_STARTS, _ROUNDS = 2, 8


def unexplained(structure: Structure, constants: Mapping[str, float], told: Situation, course: Course) -> bool:
    """Whether a structure with these constants fails to explain the readings of a course."""
    laws = laws_of_fit(structure, told)
    unit = on_unit(laws, constants)[:, None]
    apart = laws.misfits(course, structure.label, unit, by_legs=False)[: course.readings.size]
    return not float((apart**2).mean()) < WORSE


def mistakable(
    structure: Structure,
    constants: Mapping[str, float],
    told: Situation,
    asked: Question,
    course: Course,
    rng: random.Random,
) -> bool:
    """Whether a fit with a wrong option in place of the true one explains the readings of a course."""
    at = next(at for at, term in enumerate(structure.terms) if term.form in asked.options)
    for name in asked.options:
        if name == structure.terms[at].form:
            continue
        for _ in range(_STARTS):
            other, begun = _swapped(structure, constants, at, name, rng)
            if not unexplained(other, _fitted(other, begun, told, course), told, course):
                return True
    return False


def _fitted(structure: Structure, begun: Mapping[str, float], told: Situation, course: Course) -> Mapping[str, float]:
    """Constants from a fit, first leg by leg and then of the whole course."""
    laws = laws_of_fit(structure, told)
    unit = np.clip(on_unit(laws, begun), 0, 1)
    for by_legs in (True, False):

        def misfits(units: Array, *, by_legs: bool = by_legs) -> Array:
            return laws.misfits(course, structure.label, units, by_legs=by_legs)

        unit = refined(misfits, unit, _ROUNDS)
    return laws.constants(structure.label, unit)


def _swapped(
    structure: Structure, constants: Mapping[str, float], at: int, name: str, rng: random.Random
) -> tuple[Structure, dict[str, float]]:
    """A structure with another form in place of a term; its constants are drawn, the others are kept."""
    kept = tuple(part for part in structure.terms[at].modulations if FORMS[name].group in MODULATIONS[part].fits)
    new = Term(name, kept)
    rest = [term for number, term in enumerate(structure.terms) if number != at]
    other = Structure(structure.apparatus, (*rest, new), structure.radius)
    found = draw_constants(other, rng) | {name: constants[name] for name in ("m", "m2") if name in constants}
    for old, term in enumerate(structure.terms):
        if old != at:
            names = zip(term.ranges(other.terms.index(term)), term.ranges(old), strict=True)
            found |= {there: constants[here] for there, here in names}
    return other, found
