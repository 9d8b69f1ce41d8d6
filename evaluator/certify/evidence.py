"""Information in the readings of an episode about the answer, by the Cramér-Rao bound.

The calls of the episode are replayed at the sampled values, and with each continuous hidden constant slightly larger
and slightly smaller. With the derivatives J of all readings with respect to the constants, and the covariance Σ of the
readings, the Fisher information is F = Jᵀ Σ⁻¹ J + 12 I. Constants are in units of their ranges, and 12 is the inverse
variance of a uniform distribution. No unbiased estimator of an answer with gradient g has a standard error below
sqrt(gᵀ F⁻¹ g).

Where a constant moves a contact or releases a latch, readings jump, and the one-sided derivatives differ. Such readings
are marked as rough and ignored. If they decide whether the evidence suffices, the evidence is not measurable.

Discrete values are compared by replaying the calls with other values. For a family of laws, the pack's own fits
(`rivals`) are used instead.
"""

import contextlib
import math
import time
from collections.abc import Iterator, Sequence
from itertools import groupby
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evaluator.agents.reference import calls_and_readings
from evaluator.certify.constants import Constants
from evaluator.certify.probing import Array, NotMeasurable, Read, joined, numbers, replayed
from evaluator.certify.subject import Subject
from evaluator.records.episode import Episode
from evaluator.records.evidence import SUFFICIENT, CallEvidence, EvidenceRecord, Rival
from physment_mcp.errors import SceneError
from scenes import AnswerKind, KnobValue, PackError
from scenes.family import EXCLUDED_SIGMAS, surviving

Flags = NDArray[np.bool_]

PRIOR = 12.0
"""Inverse variance of a constant with a uniform distribution, in units of its range."""
_SHIFTS = (1e-4, 2e-2)
"""Finite-difference steps, as shares of a constant's range; the second is for readings that are rough at the first."""
_ROUGH, _TOLD = 0.25, 1.0
"""Relative difference of the one-sided derivatives above which a reading is rough, and the smallest relevant effect:
the change of the reading over the constant's whole range, in standard deviations."""
_FLOOR = 1e-6
"""Assumed relative standard deviation of readings at full precision."""
_APART = 6.0
"""Largest difference between a stored reading and the true value, in standard deviations."""


class Information(NamedTuple):
    """Information that the readings of an episode contain about the constants."""

    whitened: Array
    """Derivatives of the readings by the constants, in units of independent standard deviations (readings, constants);
    rough readings are 0."""
    rough: Array
    """`whitened` with the derivatives of rough readings included."""
    whiten: Array
    """Whitening matrix of the readings (readings, readings)."""
    values: Array
    """The readings at the drawn values."""
    calls: tuple[int, ...]
    """For each reading, the number of its call, from 0."""

    def fisher(self, rows: Sequence[int]) -> Array:
        """Fisher information of selected readings and of the prior about the constants."""
        part = self.whitened[list(rows)]
        return PRIOR * np.eye(part.shape[1]) + part.T @ part

    @property
    def fisher_with_rough(self) -> Array:
        """Fisher information of all readings, rough ones included, and of the prior."""
        return PRIOR * np.eye(self.rough.shape[1]) + self.rough.T @ self.rough


def information(constants: Constants, episode: Episode) -> Information:
    """Compute the information of an episode's readings about the constants.

    Raises:
        NotMeasurable: The recorded results differ from the laboratory's, or shifted constants make a call fail.
    """
    files = constants.subject.files
    base = replayed(files, constants.mjcf(), episode, slopes=True)
    _refuse_other_record(base, episode)
    values = joined(base)
    whiten = whitening(base)
    smooth, rough = (np.zeros((len(values), len(constants.names))) for _ in range(2))
    for column, name in enumerate(constants.names):
        above, below = _slopes(constants, episode, base, name, _SHIFTS[0])
        torn = _is_rough(above, below, whiten)
        if torn.any():
            wide = _slopes(constants, episode, base, name, _SHIFTS[1])
            settled = torn & ~_is_rough(*wide, whiten)
            above, below = np.where(settled, wide[0], above), np.where(settled, wide[1], below)
            torn = torn & ~settled
        rough[:, column] = (above + below) / 2
        smooth[:, column] = np.where(torn, 0.0, rough[:, column])
    calls = tuple(read.place for read in base for _ in read.values)
    return Information(whiten @ smooth, whiten @ rough, whiten, values, calls)


def _slopes(
    constants: Constants, episode: Episode, base: Sequence[Read], name: str, shift: float
) -> tuple[Array, Array]:
    """One-sided derivatives of the readings with respect to a constant, from above and from below."""
    middle = joined(base)
    ends: list[Array] = []
    for by in (shift, -shift):
        reads = replayed(constants.subject.files, constants.mjcf({name: by}), episode, slopes=False)
        values = joined(reads)
        if values.shape != middle.shape:
            raise NotMeasurable("the tools return other numbers of readings for neighbouring hidden values")
        ends.append((values - middle) / by)
    return ends[0], ends[1]


def _is_rough(above: Array, below: Array, whiten: Array) -> Flags:
    """Return a mask of the readings that have no derivative but depend noticeably on the constant."""
    largest = np.maximum(np.abs(above), np.abs(below))
    matters = largest * np.abs(np.diag(whiten)) > _TOLD
    return matters & (np.abs(above - below) > _ROUGH * largest)


def whitening(reads: Sequence[Read]) -> Array:
    """The matrix W with Wᵀ W = Σ⁻¹. It is lower triangular, so a row depends only on its reading and earlier ones."""
    size = sum(len(read.values) for read in reads)
    whiten, begin = np.zeros((size, size)), 0
    for _, group in groupby(reads, key=attrgetter("time")):
        moment = list(group)
        errors = sorted({error for read in moment for error in read.slopes})
        slopes = np.vstack(
            [
                np.column_stack([read.slopes.get(error, np.zeros(len(read.values))) for error in errors])
                if errors
                else np.zeros((len(read.values), 0))
                for read in moment
            ]
        )
        floor = _FLOOR * (1.0 + np.abs(joined(moment)))
        covariance = slopes @ slopes.T + np.diag(floor**2)
        end = begin + len(floor)
        whiten[begin:end, begin:end] = np.linalg.inv(np.linalg.cholesky(covariance))
        begin = end
    return whiten


def _refuse_other_record(base: Sequence[Read], episode: Episode) -> None:
    """Raise if the readings of a record differ from the laboratory's, for example because it was edited."""
    stored = [exchange.content for _, exchange in episode.accepted_calls()]
    for read in base:
        values = np.array(list(numbers(stored[read.place] or {})))
        spread = sum((slope**2 for slope in read.slopes.values()), np.zeros(len(read.values)))
        allowed = _APART * np.sqrt(spread) + 1e-5 * (1.0 + np.abs(read.values))
        told = bool(read.slopes) or not _has_errors(base)
        if values.shape != read.values.shape or (told and (np.abs(values - read.values) > allowed).any()):
            raise NotMeasurable(f"call {read.place + 1} of the record is not what the laboratory returns")


def _has_errors(reads: Sequence[Read]) -> bool:
    return any(read.slopes for read in reads)


MOST = 24
"""Largest number of changes of discrete values that are replayed."""


class Other(NamedTuple):
    """Values of discrete constants that differ from the sampled ones and give another answer."""

    name: str
    apart: Array | None
    """Whitened change of the readings; None if a replay with these values returns results of another form."""


def others_of(constants: Constants, told: Information, episode: Episode, fitted: Sequence[Rival] | None) -> list[Other]:
    """Return the changes of one discrete value that give another answer, except those that change a fitted law."""
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
    """Return rivals from the pack's own fits; None if the pack defines no fits, or if they cannot fit these calls."""
    solution = constants.subject.solution
    if solution.rivals is None or solution.structure is None:
        return None
    drawn = solution.structure(constants.values())
    fits = None
    with contextlib.suppress(Exception):  # fits are written for the reference's calls
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
"""Chi-square of a rival whose replay returns results of another form."""


def measured(subject: Subject, seed: int, episode: Episode, line_sha256: str) -> EvidenceRecord:
    """Measure the evidence of an episode.

    Args:
        subject: The scene of the episode.
        seed: Seed of the episode.
        episode: The episode.
        line_sha256: SHA-256 of the episode's line in `episodes.jsonl`.
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
        return {}  # no readings
    fitted = fitted_rivals(constants, episode)
    others = others_of(constants, told, episode, fitted)
    steps = list(_steps(constants, told, others, [turn for turn, _ in episode.accepted_calls()]))
    loosest = steps[-1].bounds if steps else ()
    tightest = constants.bounds(told.fisher_with_rough)
    if max(tightest, default=0.0) <= SUFFICIENT < max(loosest, default=0.0):
        raise NotMeasurable("readings that jump with the hidden values would decide whether the evidence suffices")
    rivals = [*(fitted or ()), *(_rival(told, other) for other in others)]
    return {"calls": tuple(steps), "rivals": tuple(rivals)}


def _steps(
    constants: Constants, told: Information, others: Sequence[Other], turns: Sequence[int]
) -> Iterator[CallEvidence]:
    """Yield the evidence after each call with a reading."""
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
    """Return the chi-square of the readings for other discrete values, minimised over the continuous constants.

    The minimisation is a linear least-squares fit.
    """
    if other.apart is None:
        return _FAR
    apart = other.apart[rows]
    along = told.whitened[rows].T @ apart
    return float(min(apart @ apart - along @ np.linalg.solve(fisher, along), _FAR))


def _rival(told: Information, other: Other) -> Rival:
    rows = range(len(told.calls))
    distance = _distance(told, other, rows, told.fisher(rows))
    return Rival(name=other.name, chi_square=float(f"{distance:.4g}"), excluded=distance > EXCLUDED_SIGMAS**2)
