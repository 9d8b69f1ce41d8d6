"""Certificates of worlds by fits of other structures: the answers are determined, and the options distinguishable.

"Determined": every similar structure that explains the readings gives the same answers. Similar structures have one
form or modulation more or less than the true one, or one term replaced. Only those additions and replacements are
tested that a score test ranks highest (`Search.neighbours`). A structure explains the readings if the
chi-square test of `scenes.family` does not exclude it. An agent that infers such a structure has made no mistake, so
its answers must be right too. "Distinguishable": no wrong option of a `which` question explains the readings in place
of the true one.
"""

import itertools
import random
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from scenes.family import largest_excess
from scenes.fitting import Array, refined
from scenes.worlds.answering import answers
from scenes.worlds.candidates import Fit
from scenes.worlds.catalogue import FORMS, MODULATIONS
from scenes.worlds.course_fits import on_course
from scenes.worlds.drawing import draw_constants
from scenes.worlds.experiment import SEARCH_S, course_misfits, laws_of_fit, on_unit
from scenes.worlds.questions import Question, tolerance
from scenes.worlds.refits import WORSE, Refits, constants_of
from scenes.worlds.terms import Structure, Term
from scenes.worlds.weak_form import named

_ROUNDS = 6
_STEP_S = 0.05


def rival_of(refits: Refits, asked: Sequence[Question], key: Array, before: Fit | None = None) -> Fit | None:
    """Find a structure that explains the readings as well as the true one but gives other answers, if there is one.

    Args:
        refits: The readings of the sampled world.
        asked: The questions.
        key: The right answers to the questions.
        before: A rival that was found with other readings; it is tried first.
    """
    search, drawn = refits.search, refits.drawn
    first = [] if before is None else [(before.structure, before.unit)]
    with np.errstate(all="ignore"):
        others = itertools.chain(first, search.neighbours(drawn))
        rivals = (search.fit(*near, _ROUNDS) for near in others if near[0] != drawn.structure)
        return next((fit for fit in _as_good(rivals, drawn) if not _right(fit, asked, key)), None)


def _as_good(rivals: Iterator[Fit], drawn: Fit) -> Iterator[Fit]:
    """Yield the fits whose chi-square does not significantly exceed that of the true law, as in `scenes.family`."""
    for fit in rivals:
        if fit.chi_square - drawn.chi_square <= largest_excess(len(drawn.unit) - len(fit.unit)):
            yield fit


def _right(fit: Fit, asked: Sequence[Question], key: Array) -> bool:
    """Return whether every answer computed from the fitted law would be graded as correct."""
    found = answers(fit.structure, named(fit.structure, fit.unit[:, None]), asked, _STEP_S)[:, 0]
    return bool((np.abs(found - key) <= tolerance(key)).all())


def removable(refits: Refits, asked: Sequence[Question], key: Array) -> bool:
    """Return whether the answers do not depend on the bias, or on the drift, of the position instrument.

    That is, a fit of the true structure that neglects one of them gives right answers.

    Args:
        refits: The readings of the sampled world.
        asked: The questions.
        key: The right answers to the questions.
    """
    for part in ("bias", "drift"):
        if getattr(refits.told, part):
            told = replace(refits.told, **{part: 0.0})
            naive = on_course(refits.course, told, refits.drawn, SEARCH_S)
            if _right(naive, asked, key):
                return True
    return False


_NEAR = 3.0
"""Threshold of the mean square of the legs' misfits for fitting the whole course, as a multiple of `WORSE`."""
_STARTS, _REFIT_ROUNDS = 2, 8


def mistakable(refits: Refits, constants: Mapping[str, float], asked: Question, rng: random.Random) -> bool:
    """Return whether a fit with a wrong option in place of the true one explains the readings.

    Args:
        refits: The readings of the sampled world.
        constants: Its constants.
        asked: The question with the options.
        rng: Random stream for the initial constants of the fits.
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
    """Return the constants of a fit to all legs in sequence, starting from a fit leg by leg."""
    laws, label = laws_of_fit(fit.structure, refits.told), fit.structure.label

    def misfits(units: Array) -> Array:
        return course_misfits(fit.structure, refits.told, laws, refits.course, units)

    begun = np.clip(on_unit(laws, constants_of(fit)), 0, 1)
    return laws.constants(label, refined(misfits, begun, _REFIT_ROUNDS))


def _swapped(
    structure: Structure, constants: Mapping[str, float], at: int, name: str, rng: random.Random
) -> tuple[Structure, dict[str, float]]:
    """Replace the form of a term in a structure. Constants of the new term are sampled, all others are unchanged."""
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
