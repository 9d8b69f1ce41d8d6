"""What the experiments of an episode could tell, whoever reasons about them: the bound of Cramér and Rao.

The calls of the episode are played again at the drawn values, and with every continuous hidden constant a little larger
and a little smaller. With the derivatives J of all readings by the constants, and their covariance Σ, the Fisher
information is F = Jᵀ Σ⁻¹ J + 12 I: constants are counted in their ranges, and 12 is the inverse variance of a uniform
one. No unbiased inference has a standard error below sqrt(gᵀ F⁻¹ g) for an answer with the gradient g.

Where a constant moves a contact or springs a latch, readings jump, and their derivatives from above and from below
differ. Such readings count for nothing; if they decide whether the evidence suffices, it is not measurable.
"""

import math
import time
from collections.abc import Iterator, Sequence
from itertools import groupby

import numpy as np

from evaluator.certify.constants import Constants
from evaluator.certify.information import PRIOR, Information, information
from evaluator.certify.probing import Array, NotMeasurable, calls_of
from evaluator.certify.rivals import Other, fitted_rivals, others_of
from evaluator.certify.subject import Subject
from evaluator.records.episode import SUFFICIENT, CallEvidence, Episode, EvidenceRecord, Rival
from physment_mcp.errors import SceneError
from scenes import AnswerKind, PackError
from scenes.family import EXCLUDED_SIGMAS

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
