"""Fisher information in the readings of an episode about the hidden constants of its scene.

The calls of the episode are replayed at the sampled values, and with each continuous hidden constant slightly larger
and slightly smaller. With the derivatives J of all readings with respect to the constants, and the covariance Σ of the
readings, the Fisher information is F = Jᵀ Σ⁻¹ J + 12 I. Constants are in units of their ranges, and 12 is the inverse
variance of a uniform distribution.

A derivative describes a reading only where the reading is linear. Readings are ignored if they jump beside the sampled
values, or if they are not linear over the standard error of the answer (Bates and Watts 1980).
"""

from collections.abc import Mapping, Sequence
from itertools import groupby
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from evaluator.certify.constants import Constants
from evaluator.certify.probing import Array, Flags, NotMeasurable, Read, Replay, joined, numbers, replayed
from evaluator.records.episode import Episode
from scenes import KnobValue

PRIOR = 12.0
"""Inverse variance of a constant with a uniform distribution, in units of its range."""
_SHIFT, _FINE, _WIDE = 1e-4, 1e-6, 2e-2
"""Finite-difference steps, as shares of a constant's range. The fine one is for readings that change over the first by
more than their standard deviation, the wide one for readings that are rough at the others."""
_ROUGH, _TOLD = 0.25, 1.0
"""Relative difference of the one-sided derivatives above which a reading is rough, and the smallest relevant effect:
the change of the reading over the constant's whole range, in standard deviations."""
_JUMP = 0.5
"""Smallest derivative at the fine step, over the steeper one of a rough reading, if the reading does not jump."""
_ENDS = 4.0
"""Factor by which the derivative at the fine step exceeds the wide one of a motion that every step drives to an end."""
_HORIZON = 100.0
"""Change of a reading over the fine step, in standard deviations, beyond which its derivative is not known."""
_BENT = 0.5
"""Largest non-linearity over one standard error of an answer: of all readings together, in standard deviations, and of
the answer that is fitted to them, in standard errors."""
_ROUNDS = 6
"""Number of times that readings are dropped because they are not linear, before no reading counts."""
_FLOOR = 1e-6
"""Assumed relative standard deviation of readings at full precision."""
_APART = 6.0
"""Largest difference between a stored reading and the true value, in standard deviations."""
_FAR = 1e9
"""Change of a reading that a shifted laboratory does not return [standard deviations]."""


class Information(NamedTuple):
    """Information that the readings of an episode contain about the constants."""

    reads: Sequence[Read]
    """The readings at the sampled values."""
    jacobian: Array
    """Derivatives of the readings with respect to the constants (readings, constants)."""
    ignored: Flags
    """Mask of the readings that do not count, because they are not linear in the constants."""
    whiten: Array
    """Whitening matrix of the counted readings (readings, readings)."""
    whitened: Array
    """The derivatives in units of independent standard deviations (readings, constants); 0 for ignored readings."""

    @classmethod
    def of(cls, reads: Sequence[Read], jacobian: Array, ignored: Flags) -> "Information":
        """Combine the derivatives of the readings with the covariance of those that count."""
        whiten = whitening(reads, ignored)
        return cls(reads, jacobian, ignored, whiten, whiten @ np.where(ignored[:, None], 0.0, jacobian))

    @property
    def values(self) -> Array:
        """The readings at the sampled values."""
        return joined(self.reads)

    @property
    def calls(self) -> tuple[int, ...]:
        """For each reading, the number of its call, from 0."""
        return tuple(read.place for read in self.reads for _ in read.values)

    def fisher(self, rows: Sequence[int]) -> Array:
        """Fisher information of selected readings and of the prior about the constants."""
        part = self.whitened[list(rows)]
        return PRIOR * np.eye(part.shape[1]) + part.T @ part

    def all_counted(self) -> "Information":
        """Return the information if every reading counted."""
        return self.of(self.reads, self.jacobian, np.zeros_like(self.ignored))


def information(constants: Constants, episode: Episode) -> Information:
    """Compute the information of an episode's readings about the constants.

    Raises:
        NotMeasurable: The recorded results differ from the laboratory's, or shifted constants make a call fail.
    """
    reads = replayed(constants.subject.files, constants.mjcf(), episode, slopes=True)
    _refuse_other_record(reads, episode)
    sigma = deviations(reads)
    jacobian = np.zeros((len(sigma), len(constants.names)))
    ignored = np.zeros(len(sigma), dtype=bool)
    for column, name in enumerate(constants.names):
        jacobian[:, column], rough = _derivative(constants, episode, reads, name, sigma)
        ignored |= rough
    return _linear(constants, episode, Information.of(reads, jacobian, ignored))


def _derivative(
    constants: Constants, episode: Episode, reads: Sequence[Read], name: str, sigma: Array
) -> tuple[Array, Flags]:
    """Return the derivatives of the readings with respect to a constant, and a mask of those that have none.

    A step over which a reading changes by more than its standard deviation is longer than the errors of an estimate.
    Where constants have nearly the same effect, the curvature over such a step appears to distinguish them.
    """
    above, below = slopes(constants, episode, reads, name)
    rough = _is_rough(above, below, sigma)
    largest = np.maximum(np.abs(above), np.abs(below))
    far, local = _SHIFT * largest > sigma, np.zeros(len(sigma))
    if far.any():
        fine = slopes(constants, episode, reads, name, _FINE)
        local = np.where(far, np.minimum(np.abs(fine[0]), np.abs(fine[1])), 0.0)
        # The derivative at the fine step omits a jump within the first step, but not the bend of a smooth change.
        jumps = rough & (local < _JUMP * largest)
        above, below = np.where(far, fine[0], above), np.where(far, fine[1], below)
        rough = np.where(far, jumps | _is_rough(*fine, sigma), rough)
    if rough.any():
        wide = slopes(constants, episode, reads, name, _WIDE)
        ends = local > _ENDS * np.maximum(np.abs(wide[0]), np.abs(wide[1]))
        settled = rough & ~_is_rough(*wide, sigma) & ~ends
        above, below = np.where(settled, wide[0], above), np.where(settled, wide[1], below)
        rough = rough & ~settled
    return (above + below) / 2, rough | (_FINE * local > _HORIZON * sigma)


def _linear(constants: Constants, episode: Episode, told: Information) -> Information:
    """Ignore the readings that are not linear over one standard error of an answer that the readings determine."""
    for _ in range(_ROUNDS):
        if not constants.are_known(told.fisher(range(len(told.ignored)))):
            return told  # a bound that does not suffice need not be exact
        bent = _bent(constants, episode, told)
        if not bent.any():
            return told
        told = Information.of(told.reads, told.jacobian, told.ignored | bent)
    return Information.of(told.reads, told.jacobian, np.ones_like(told.ignored))


def slopes(
    constants: Constants,
    episode: Episode,
    base: Sequence[Read],
    name: str,
    shift: float = _SHIFT,
    discrete: Mapping[str, KnobValue] | None = None,
) -> tuple[Array, Array]:
    """Return the one-sided derivatives of the readings with respect to a constant, from above and from below.

    Args:
        constants: The hidden values.
        episode: The episode.
        base: The readings without a shift.
        name: The constant.
        shift: Finite-difference step, as a share of the constant's range.
        discrete: Discrete constant → value to use in place of the sampled one, as in `base`.

    Raises:
        NotMeasurable: A shifted constant makes a call fail, or changes the form of a reading.
    """
    middle = joined(base)
    ends: list[Array] = []
    for by in (shift, -shift):
        reads = replayed(constants.subject.files, constants.mjcf({name: by}, discrete), episode, slopes=False)
        values = joined(reads)
        if values.shape != middle.shape:
            raise NotMeasurable("the tools return other numbers of readings for neighbouring hidden values")
        ends.append((values - middle) / by)
    return ends[0], ends[1]


def _is_rough(above: Array, below: Array, sigma: Array) -> Flags:
    """Return a mask of the readings that have no derivative but depend noticeably on the constant."""
    largest = np.maximum(np.abs(above), np.abs(below))
    return (largest > _TOLD * sigma) & (np.abs(above - below) > _ROUGH * largest)


def _bent(constants: Constants, episode: Episode, told: Information) -> Flags:
    """Return a mask of counted readings that are not linear over one standard error of the answer.

    The constants are shifted by one standard error of each requested number, in both directions. What the derivatives
    do not predict of the changes of the readings is fitted by a further shift. If a residual remains, or if a requested
    number does not change by its bound along both shifts, the readings with the largest unpredicted changes are marked.
    """
    sigma = deviations(told.reads)
    fisher = told.fisher(range(len(sigma)))
    scaled = np.where(told.ignored[:, None], 0.0, told.jacobian) / sigma[:, None]
    bent = np.zeros_like(told.ignored)
    for step in constants.steps(fisher):
        for shift in (constants.shortened(step), constants.shortened(-step)):
            predicted = told.jacobian @ np.array(list(shift.values()))
            apart = (_changes(constants, episode, told.reads, shift) - predicted) / sigma
            apart = np.where(told.ignored, 0.0, np.clip(np.nan_to_num(apart, nan=_FAR), -_FAR, _FAR))
            further = np.linalg.inv(PRIOR * np.eye(len(step)) + scaled.T @ scaled) @ scaled.T @ apart
            left = float(np.linalg.norm(apart - scaled @ further))
            if max([left, *constants.unpredicted(shift, further, fisher)]) > _BENT:
                bent |= np.abs(apart) >= min(1.0, np.abs(apart).max())
    return bent & ~told.ignored


def _changes(constants: Constants, episode: Episode, base: Sequence[Read], shift: dict[str, float]) -> Array:
    """Return the changes of the readings if constants are shifted; NaN for readings of another form, or of none."""
    replay = Replay(constants.subject.files, constants.mjcf(shift))
    found: dict[int, Array] = {}
    try:
        for place, (_, exchange) in enumerate(episode.accepted_calls()):
            read = replay.read(place, exchange.call.tool, exchange.call.arguments, slopes=False)
            if read is not None:
                found[place] = read.values
    except NotMeasurable:
        pass  # the readings of a refused call and of later ones are missing
    changes = [
        found[read.place] - read.values
        if read.place in found and found[read.place].shape == read.values.shape
        else np.full(len(read.values), np.nan)
        for read in base
    ]
    return np.concatenate(changes) if changes else np.zeros(0)


def deviations(reads: Sequence[Read]) -> Array:
    """Standard deviation of each reading."""
    errors = [sum((slope**2 for slope in read.slopes.values()), np.zeros(len(read.values))) for read in reads]
    return np.sqrt(np.concatenate(errors) + _floor(joined(reads)) ** 2) if errors else np.zeros(0)


def _floor(values: Array) -> Array:
    return _FLOOR * (1.0 + np.abs(values))


def whitening(reads: Sequence[Read], ignored: Flags | None = None) -> Array:
    """The matrix W with Wᵀ W = Σ⁻¹. It is lower triangular, so a row depends only on its reading and earlier ones.

    Args:
        reads: The readings.
        ignored: Mask of the readings whose errors are uncorrelated with the others', so that they reveal nothing about
            them; None for none.
    """
    size = sum(len(read.values) for read in reads)
    whiten, begin = np.zeros((size, size)), 0
    ignored = np.zeros(size, dtype=bool) if ignored is None else ignored
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
        floor = _floor(joined(moment))
        end = begin + len(floor)
        slopes[ignored[begin:end]] = 0.0
        covariance = slopes @ slopes.T + np.diag(floor**2)
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
