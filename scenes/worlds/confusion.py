"""Tests whether readings distinguish the options of a `which` question."""

import random
from collections.abc import Mapping

import numpy as np

from scenes.fitting import Array, refined
from scenes.worlds.candidates import Fit
from scenes.worlds.catalogue import FORMS, MODULATIONS
from scenes.worlds.drawing import draw_constants
from scenes.worlds.experiment import laws_of_fit, on_unit
from scenes.worlds.questions import Question
from scenes.worlds.refits import WORSE, Refits, constants_of
from scenes.worlds.terms import Structure, Term

_NEAR = 3.0
"""Threshold of the mean square of the legs' misfits for fitting the whole course, as a multiple of `WORSE`."""
_STARTS, _ROUNDS = 2, 8


def mistakable(refits: Refits, constants: Mapping[str, float], asked: Question, rng: random.Random) -> bool:
    """Return whether a fit with a wrong option in place of the true one explains the readings of a course.

    Args:
        refits: The readings of the drawn world.
        constants: Its constants.
        asked: The question with the options.
        rng: Draws the initial constants of the fits.
    """
    structure = refits.drawn.structure
    at = next(at for at, term in enumerate(structure.terms) if term.form in asked.options)
    for name in asked.options:
        if name == structure.terms[at].form:
            continue
        for _ in range(_STARTS):
            other, begun = _swapped(structure, constants, at, name, rng)
            fit = refits.fitted(other, begun)
            if fit.chi_square < _NEAR * WORSE * refits.course.count and not refits.unexplained(
                other, _of_course(refits, fit)
            ):
                return True
    return False


def _of_course(refits: Refits, fit: Fit) -> Mapping[str, float]:
    """Return the constants of a fit to the whole course, starting from a fit to its legs."""
    laws, label = laws_of_fit(fit.structure, refits.told), fit.structure.label

    def misfits(units: Array) -> Array:
        return laws.misfits(refits.course, label, units, by_legs=False)

    begun = np.clip(on_unit(laws, constants_of(fit)), 0, 1)
    return laws.constants(label, refined(misfits, begun, _ROUNDS))


def _swapped(
    structure: Structure, constants: Mapping[str, float], at: int, name: str, rng: random.Random
) -> tuple[Structure, dict[str, float]]:
    """Replace the form of a term in a structure; its constants are drawn, the others are kept."""
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
