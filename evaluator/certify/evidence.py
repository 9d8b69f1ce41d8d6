"""What the experiments of an episode could tell, whoever reasons about them: the bound of Cramér and Rao.

A pack that fits its family of laws (`rivals`) says itself how well each fits. Other discrete values are replayed.

The calls of the episode are played again at the drawn values, and with every continuous hidden constant a little larger
and a little smaller. With the derivatives J of all readings by the constants, and their covariance Σ, the Fisher
information is F = Jᵀ Σ⁻¹ J + 12 I: constants are counted in their ranges, and 12 is the inverse variance of a uniform
one. No unbiased inference has a standard error below sqrt(gᵀ F⁻¹ g) for an answer with the gradient g.

Where a constant moves a contact or springs a latch, readings jump, and their derivatives from above and from below
differ. Such readings count for nothing; if they decide whether the evidence suffices, it is not measurable.
"""

import contextlib
import math
import time
from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np

from evaluator.agents.reference import calls_and_readings
from evaluator.certify.constants import Constants
from evaluator.certify.information import PRIOR, Information, information
from evaluator.certify.probing import Array, NotMeasurable, calls_of, joined, replayed
from evaluator.certify.subject import Subject
from evaluator.records.episode import SUFFICIENT, CallEvidence, Episode, EvidenceRecord, Rival
from physment_mcp.errors import SceneError
from scenes import AnswerKind, KnobValue, PackError
from scenes.family import EXCLUDED_SIGMAS, surviving

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


_FAR = 1e9
"""Chi-square of what a replay contradicts altogether."""


def measured(subject: Subject, seed: int, episode: Episode, line_sha256: str) -> EvidenceRecord:
    """The evidence of an episode.

    Args:
        subject: Its scene.
        seed: The seed that it was played at.
        episode: The episode.
        line_sha256: Of its line in `episodes.jsonl`.
    """
    begun = time.process_time()
    found = EvidenceRecord(key=episode.key, episode=line_sha256)
    try:
        changes = _measured(subject, seed, episode)
    except (NotMeasurable, PackError, SceneError) as error:
        changes = {"not_measurable": str(error)}
    return found.model_copy(update={**changes, "seconds": round(time.process_time() - begun, 3)})


def _measured(subject: Subject, seed: int, episode: Episode) -> dict[str, object]:
    if not subject.pack.knobs:
        raise NotMeasurable("the pack draws no hidden values")
    if subject.spec.kind in {AnswerKind.FORMULA, AnswerKind.TEXT}:
        raise NotMeasurable(f"the answer is a {subject.spec.kind.value}")
    constants = Constants.of(subject, seed)
    told = information(constants, episode)
    if not told.calls:
        return {}  # nothing was read, so nothing is known
    fitted = fitted_rivals(constants, episode)
    others = others_of(constants, told, episode, fitted)
    steps = list(_steps(constants, told, others, [turn for turn, _ in calls_of(episode)]))
    loosest = steps[-1].bounds if steps else ()
    tightest = constants.bounds(told.fisher_with_rough)
    if max(tightest, default=0.0) <= SUFFICIENT < max(loosest, default=0.0):
        raise NotMeasurable("readings that jump with the hidden values would decide whether the evidence suffices")
    rivals = [*(fitted or ()), *(_rival(told, other) for other in others)]
    return {"calls": tuple(steps), "rivals": tuple(rivals)}


def _steps(
    constants: Constants, told: Information, others: Sequence[Other], turns: Sequence[int]
) -> Iterator[CallEvidence]:
    """What is known after each call that read something."""
    seen: list[int] = []
    for call, rows in groupby(range(len(told.calls)), key=told.calls.__getitem__):
        seen += rows
        fisher = told.fisher(seen)
        sign, volume = np.linalg.slogdet(fisher / PRIOR)
        yield CallEvidence(
            turn=turns[call],
            call=call + 1,
            bounds=tuple(float(f"{bound:.4g}") for bound in constants.bounds(fisher)),
            choice=constants.choice_probability(fisher),
            rivals=sum(_distance(told, other, seen, fisher) <= EXCLUDED_SIGMAS**2 for other in others),
            bits=round(0.5 * float(sign * volume) / math.log(2), 2),
        )


def _distance(told: Information, other: Other, rows: Sequence[int], fisher: Array) -> float:
    """Chi-square of readings by other discrete values, the continuous constants adjusted by linear least squares."""
    if other.apart is None:
        return _FAR
    apart = other.apart[rows]
    along = told.whitened[rows].T @ apart
    return float(min(apart @ apart - along @ np.linalg.solve(fisher, along), _FAR))


def _rival(told: Information, other: Other) -> Rival:
    rows = range(len(told.calls))
    distance = _distance(told, other, rows, told.fisher(rows))
    return Rival(name=other.name, chi_square=float(f"{distance:.4g}"), excluded=distance > EXCLUDED_SIGMAS**2)
