"""Other structures and discrete values than the drawn ones: what they answer, and how far from the readings they are.

A pack that fits its family of laws (`rivals`) says itself how well each fits. Other discrete values are replayed.
"""

import contextlib
from collections.abc import Sequence
from typing import NamedTuple

from evaluator.agents.protocol_player import calls_and_readings
from evaluator.certify.constants import Constants
from evaluator.certify.information import Information
from evaluator.certify.probing import Array, NotMeasurable, joined, replayed
from evaluator.records.episode import Episode, Rival
from scenes import KnobValue, PackError
from scenes.family import surviving

MOST = 24
"""Most changes of discrete values that are replayed."""


class Other(NamedTuple):
    """Other discrete values that give another answer."""

    name: str
    apart: Array | None
    """By how much they change the readings, whitened; None if a replay with them returns other things altogether."""


def others_of(constants: Constants, told: Information, episode: Episode, fitted: Sequence[Rival] | None) -> list[Other]:
    """The changes of one discrete value that give another answer; of a fitted structure none."""
    structure = constants.subject.solution.structure
    found: list[Other] = []
    for name, change in constants.others():
        law = structure and structure(constants.values(discrete=change))
        if fitted is not None and structure is not None and law != structure(constants.values()):
            continue
        if _differs(constants, change):
            found.append(Other(name, _apart(constants, told, episode, change)))
        if len(found) == MOST:
            break
    return found


def _differs(constants: Constants, change: dict[str, KnobValue]) -> bool:
    try:
        return not constants.subject.agrees(constants.answer(discrete=change), constants.key)
    except (NotMeasurable, PackError):
        return False  # no such draw


def fitted_rivals(constants: Constants, episode: Episode) -> list[Rival] | None:
    """What the pack's own fits say; None if it has none, or if they do not take these calls."""
    solution = constants.subject.solution
    if solution.rivals is None or solution.structure is None:
        return None
    drawn = solution.structure(constants.values())
    fits = None
    with contextlib.suppress(Exception):  # written for the reference's calls; others may not fit
        fits = solution.rivals(calls_and_readings(episode))
    if fits is None or drawn not in fits or drawn not in surviving(fits):
        return None
    alive = surviving(fits)
    return [
        Rival(name=name, chi_square=max(0.0, fit.chi_square - fits[drawn].chi_square), excluded=name not in alive)
        for name, fit in fits.items()
        if name != drawn and not constants.subject.agrees(fit.answer, constants.key)
    ]


def _apart(constants: Constants, told: Information, episode: Episode, change: dict[str, KnobValue]) -> Array | None:
    try:
        reads = replayed(constants.subject.files, constants.mjcf(discrete=change), episode, slopes=False)
    except (NotMeasurable, PackError):
        return None
    values = joined(reads)
    return told.whiten @ (values - told.values) if values.shape == told.values.shape else None
