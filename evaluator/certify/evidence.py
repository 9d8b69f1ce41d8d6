"""Information in the readings of an episode about the answer, by the Cramér-Rao bound.

If F is the Fisher information of the readings about the hidden constants (`information`), no unbiased estimator of an
answer with gradient g has a standard error below sqrt(gᵀ F⁻¹ g). Readings that are not linear in the constants are
ignored. If they decide whether the evidence suffices, the evidence is not measurable.

Discrete values are compared by replaying the calls with other values. For a family of laws, the pack's own fits
(`rivals`) are used instead.
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
from evaluator.certify.information import PRIOR, Information, information, slopes
from evaluator.certify.probing import Array, NotMeasurable, joined, replayed
from evaluator.certify.subject import Subject
from evaluator.records.episode import Episode
from evaluator.records.evidence import CallEvidence, EvidenceRecord, Rival
from physment_mcp.errors import SceneError
from scenes import AnswerKind, KnobValue, PackError
from scenes.family import EXCLUDED_SIGMAS, surviving

MOST = 24
"""Largest number of changes of discrete values that are replayed."""


class Other(NamedTuple):
    """Values of discrete constants that differ from the sampled ones and give another answer."""

    name: str
    change: Array | None
    """Change of the readings; None if a replay with these values returns results of another form."""
    jacobian: Array
    """Derivatives of the readings with respect to the continuous constants at these values (readings, constants)."""


def others_of(constants: Constants, episode: Episode, told: Information, fitted: Sequence[Rival] | None) -> list[Other]:
    """Return the changes of one discrete value that give another answer, except those that change a fitted law."""
    structure = constants.subject.solution.structure
    found: list[Other] = []
    for name, change in constants.others():
        law = structure and structure(constants.values(discrete=change))
        if fitted is not None and structure is not None and law != structure(constants.values()):
            continue
        if _differs(constants, change):
            found.append(_other(constants, episode, told, name, change))
        if len(found) == MOST:
            break
    return found


def _differs(constants: Constants, change: dict[str, KnobValue]) -> bool:
    try:
        return not constants.subject.agrees(constants.answer(discrete=change), constants.key)
    except (NotMeasurable, PackError):
        return False  # these values cannot be sampled


def fitted_rivals(constants: Constants, episode: Episode) -> list[Rival] | None:
    """Return rivals from the pack's own fits; None if the pack defines no fits, or if they cannot fit these calls.

    Each is compared with the true law alone: of many laws, one may fit better than the true one by chance.

    Raises:
        NotMeasurable: The fits of a generated pack fail, or exclude its law.
    """
    solution = constants.subject.solution
    if solution.rivals is None or solution.structure is None:
        return None
    drawn = solution.structure(constants.values())
    fits = None
    with contextlib.suppress(Exception):  # fits are written for the reference's calls
        fits = solution.rivals(calls_and_readings(episode))
    if fits is None or drawn not in fits or drawn not in surviving(fits):
        if solution.generated:  # its fits are written for any calls, and no discrete value stands for another law
            raise NotMeasurable("the fits of other laws fail, or exclude the true one")
        return None
    return [
        Rival(
            name=name,
            chi_square=max(0.0, fit.chi_square - fits[drawn].chi_square),
            excluded=name not in surviving({drawn: fits[drawn], name: fit}),
        )
        for name, fit in fits.items()
        if name != drawn and not constants.subject.agrees(fit.answer, constants.key)
    ]


def _other(
    constants: Constants, episode: Episode, told: Information, name: str, discrete: dict[str, KnobValue]
) -> Other:
    """Replay the calls with other discrete values.

    The derivatives are computed at these values, because a constant may have an effect only with some of them.

    Raises:
        NotMeasurable: A constant that is shifted makes a call fail.
    """
    missing = Other(name, None, np.zeros_like(told.jacobian))
    try:
        reads = replayed(constants.subject.files, constants.mjcf(discrete=discrete), episode, slopes=False)
    except (NotMeasurable, PackError):
        return missing
    values = joined(reads)
    if values.shape != told.values.shape:
        return missing
    ends = [slopes(constants, episode, reads, constant, discrete=discrete) for constant in constants.names]
    columns = [(above + below) / 2 for above, below in ends]
    return Other(name, values - told.values, np.column_stack(columns) if columns else missing.jacobian)


_FAR = 1e9
"""Chi-square of a rival whose replay returns results of another form."""


def measured(
    subject: Subject, seed: int, episode: Episode, line_sha256: str, *, fit_rivals: bool = True
) -> EvidenceRecord:
    """Measure the evidence of an episode.

    Args:
        subject: The scene of the episode.
        seed: Seed of the episode.
        episode: The episode.
        line_sha256: SHA-256 of the episode's line in `episodes.jsonl`.
        fit_rivals: Whether to fit the rivals of a generated pack. They change nothing in the evidence after each call.
    """
    begun = time.process_time()
    found = EvidenceRecord(key=episode.key, episode=line_sha256)
    try:
        changes = _measured(subject, seed, episode, fit_rivals=fit_rivals)
    except (NotMeasurable, PackError, SceneError) as error:
        changes = {"not_measurable": str(error)}
    return found.model_copy(update={**changes, "seconds": round(time.process_time() - begun, 3)})


def _measured(subject: Subject, seed: int, episode: Episode, *, fit_rivals: bool) -> dict[str, object]:
    if not subject.knobs:
        raise NotMeasurable("the pack draws no hidden values")
    if subject.spec.kind in {AnswerKind.FORMULA, AnswerKind.TEXT}:
        raise NotMeasurable(f"the answer is a {subject.spec.kind.value}")
    constants = Constants.of(subject, seed)
    told = information(constants, episode)
    if not told.calls:
        return {}  # no readings
    fitted = fitted_rivals(constants, episode) if fit_rivals or not subject.solution.generated else []
    others = others_of(constants, episode, told, fitted)
    turns = [turn for turn, _ in episode.accepted_calls()]
    steps = list(_steps(constants, told, others, turns))
    if told.ignored.any() and not steps[-1].suffices:
        *_, most = _steps(constants, told.all_counted(), others, turns)
        if most.suffices:
            raise NotMeasurable("readings not linear in the hidden values decide whether the evidence suffices")
    return {"calls": tuple(steps), "rivals": (*(fitted or ()), *(_rival(told, other) for other in others))}


def _steps(
    constants: Constants, told: Information, others: Sequence[Other], turns: Sequence[int]
) -> Iterator[CallEvidence]:
    """Yield the evidence after each call with a reading."""
    seen: list[int] = []
    whitened = [_whitened(told, other) for other in others]
    for call, rows in groupby(range(len(told.calls)), key=told.calls.__getitem__):
        seen += rows
        fisher = told.fisher(seen)
        sign, volume = np.linalg.slogdet(fisher / PRIOR)
        yield CallEvidence(
            turn=turns[call],
            call=call + 1,
            bounds=tuple(float(f"{bound:.4g}") for bound in constants.bounds(fisher)),
            choice=constants.choice_probability(fisher),
            rivals=sum(_distance(other, seen) <= EXCLUDED_SIGMAS**2 for other in whitened),
            bits=round(0.5 * float(sign * volume) / math.log(2), 2),
        )


def _whitened(told: Information, other: Other) -> Other:
    """Return the change and the derivatives in units of independent standard deviations; 0 for ignored readings."""
    if other.change is None:
        return other
    change = told.whiten @ np.where(told.ignored, 0.0, other.change)
    return Other(other.name, change, told.whiten @ np.where(told.ignored[:, None], 0.0, other.jacobian))


def _distance(whitened: Other, rows: Sequence[int]) -> float:
    """Return the chi-square of selected readings for other discrete values, minimised over the continuous constants.

    The minimisation is a linear least-squares fit, with the prior of the constants.
    """
    if whitened.change is None:
        return _FAR
    apart, along = whitened.change[rows], whitened.jacobian[rows]
    normal = PRIOR * np.eye(along.shape[1]) + along.T @ along
    return float(min(apart @ apart - (along.T @ apart) @ np.linalg.solve(normal, along.T @ apart), _FAR))


def _rival(told: Information, other: Other) -> Rival:
    distance = _distance(_whitened(told, other), range(len(told.calls)))
    return Rival(name=other.name, chi_square=float(f"{distance:.4g}"), excluded=distance > EXCLUDED_SIGMAS**2)
