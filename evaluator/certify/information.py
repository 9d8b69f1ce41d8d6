"""What the readings of an episode tell of the hidden constants: their derivatives and their covariance.

A reading whose derivatives from above and from below differ, because the constant moves a contact or springs a latch,
has no derivative; it is marked as rough.
"""

from collections.abc import Sequence
from itertools import groupby
from operator import attrgetter
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evaluator.certify.constants import Constants
from evaluator.certify.probing import Array, NotMeasurable, Read, calls_of, joined, numbers, replayed
from evaluator.records.episode import Episode

Flags = NDArray[np.bool_]

PRIOR = 12.0
"""Inverse variance of a constant that is uniform in its range, counted in this range."""
_SHIFTS = (1e-4, 2e-2)
"""By which share of its range a constant is shifted; the second where readings are rough at the scale of the first."""
_ROUGH, _TOLD = 0.25, 1.0
"""Difference of the two one-sided derivatives, over the larger one, from which on a reading is rough; it matters if the
whole range of the constant changes the reading by so many standard deviations."""
_FLOOR = 1e-6
"""Standard deviation of a reading of full precision, over its size: nobody infers from more digits."""
_APART = 6.0
"""Standard deviations by which a stored reading may differ from the true one."""


class Information(NamedTuple):
    """What all readings of an episode tell of the constants."""

    whitened: Array
    """Derivatives of the readings by the constants, in units of independent standard deviations (readings, constants);
    rough readings are 0."""
    rough: Array
    """The same with rough readings."""
    whiten: Array
    """Takes the readings to these units (readings, readings)."""
    values: Array
    """The readings at the drawn values."""
    calls: tuple[int, ...]
    """For each reading, the number of its call, from 0."""

    def fisher(self, rows: Sequence[int]) -> Array:
        """Fisher information of some readings on the constants, that of their ranges included."""
        part = self.whitened[list(rows)]
        return PRIOR * np.eye(part.shape[1]) + part.T @ part

    @property
    def fisher_with_rough(self) -> Array:
        """The same of all readings, rough ones too."""
        return PRIOR * np.eye(self.rough.shape[1]) + self.rough.T @ self.rough


def information(constants: Constants, episode: Episode) -> Information:
    """What the readings of an episode tell of the constants.

    Raises:
        NotMeasurable: The record is not what the laboratory returns, or a neighbouring draw refuses a call.
    """
    files = constants.subject.files
    base = replayed(files, constants.mjcf(), episode, slopes=True)
    _refuse_other_record(base, episode)
    values = joined(base)
    whiten = _whitening(base)
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
    """Derivatives of the readings by a constant from above and from below."""
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
    """Which readings have no derivative, as far as it matters."""
    largest = np.maximum(np.abs(above), np.abs(below))
    matters = largest * np.abs(np.diag(whiten)) > _TOLD
    return matters & (np.abs(above - below) > _ROUGH * largest)


def _whitening(reads: Sequence[Read]) -> Array:
    """The matrix W with Wᵀ W = Σ⁻¹: lower triangular, so that a reading counts by what it adds to those before it."""
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
    """Refuse a record whose readings are not those of the laboratory, such as one that somebody edited."""
    stored = [exchange.content for _, exchange in calls_of(episode)]
    for read in base:
        values = np.array(list(numbers(stored[read.place] or {})))
        spread = sum((slope**2 for slope in read.slopes.values()), np.zeros(len(read.values)))
        allowed = _APART * np.sqrt(spread) + 1e-5 * (1.0 + np.abs(read.values))
        told = bool(read.slopes) or not _has_errors(base)
        if values.shape != read.values.shape or (told and (np.abs(values - read.values) > allowed).any()):
            raise NotMeasurable(f"call {read.place + 1} of the record is not what the laboratory returns")


def _has_errors(reads: Sequence[Read]) -> bool:
    return any(read.slopes for read in reads)
