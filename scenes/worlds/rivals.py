"""Certificate "determined": every similar structure that explains the readings gives the same answers.

Similar structures have one form or modulation more or less than the drawn one, or one term replaced. A structure
explains the readings if the rule of `scenes.family` does not exclude it. An agent that infers such a structure has made
no mistake, so its answers must be right too.
"""

import itertools
import math
from collections.abc import Iterator, Sequence

import numpy as np
from scipy.special import chdtri

from scenes.family import EXCLUDED_SIGMAS
from scenes.fitting import Array
from scenes.worlds.answering import answers
from scenes.worlds.candidates import Fit
from scenes.worlds.questions import Question, tolerance
from scenes.worlds.refits import Refits
from scenes.worlds.weak_form import named

_ROUNDS = 6
_STEP_S = 0.05
_CHANCE = math.erfc(EXCLUDED_SIGMAS / math.sqrt(2))


def rival_of(refits: Refits, asked: Sequence[Question], key: Array, before: Fit | None = None) -> Fit | None:
    """Find a structure that explains a course as well as the drawn one but gives other answers; None without one.

    Args:
        refits: The readings of the drawn world.
        asked: The questions.
        key: Their answers.
        before: A rival in other readings, which is tried first.
    """
    search, drawn = refits.search, refits.drawn
    first = [] if before is None else [(before.structure, before.unit)]
    with np.errstate(all="ignore"):
        others = itertools.chain(first, search.neighbours(drawn))
        rivals = (search.fit(*near, _ROUNDS) for near in others if near[0] != drawn.structure)
        return next((fit for fit in _as_good(rivals, drawn) if not _right(fit, asked, key)), None)


def _as_good(rivals: Iterator[Fit], drawn: Fit) -> Iterator[Fit]:
    """Return the fits that the rule of `scenes.family` does not exclude in comparison with the drawn law."""
    for fit in rivals:
        spared = max(len(drawn.unit) - len(fit.unit), 1)
        if fit.chi_square - drawn.chi_square <= float(chdtri(float(spared), _CHANCE)):
            yield fit


def _right(fit: Fit, asked: Sequence[Question], key: Array) -> bool:
    """Return whether a rival gives all answers of the key."""
    found = answers(fit.structure, named(fit.structure, fit.unit[:, None]), asked, _STEP_S)[:, 0]
    return bool((np.abs(found - key) <= tolerance(key)).all())
