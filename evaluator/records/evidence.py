"""Records of how well the experiments of an episode determine its answer. Independent of files and the engine."""

from collections.abc import Iterable
from enum import StrEnum
from statistics import NormalDist
from typing import Literal

from pydantic import Field

from evaluator.records.episode import EpisodeKey, Record, Verdict

SUFFICIENT = 0.5
"""Largest error bound of an answer for which its evidence suffices [tolerances]."""
CERTAIN = 0.95
"""Smallest probability of the right choice for which the evidence for a choice suffices."""


class CallEvidence(Record):
    """The evidence after a call."""

    turn: int
    """Number of the turn, from 1."""
    call: int
    """Number of the call in the episode, from 1."""
    bounds: tuple[float, ...]
    """For each requested number, the lower bound of its standard error (Cramér-Rao) divided by its tolerance."""
    choice: float | None = None
    """Probability of the right choice over constants that the readings allow; null if no choice is requested."""
    rivals: int = 0
    """Number of other discrete values with another answer that the readings do not exclude."""
    bits: float
    """Information about the hidden constants, beyond their ranges [bit]."""

    @property
    def suffices(self) -> bool:
        """Return whether the readings determine the constants well enough and exclude other discrete values."""
        known = max(self.bounds, default=0.0) <= SUFFICIENT and (self.choice is None or self.choice >= CERTAIN)
        return known and not self.rivals

    @property
    def worst_bound(self) -> float:
        """Return the largest bound, which is at most `SUFFICIENT` if and only if the evidence suffices [tolerances].

        The probability of the right choice counts as an equivalent bound, as the function `worst_bound` describes. So
        does the probability 1 / (1 + k) if the readings do not exclude k other discrete values.
        """
        chances = [] if self.choice is None else [self.choice]
        return worst_bound(self.bounds, [*chances, 1 / (1 + self.rivals)])


def worst_bound(bounds: Iterable[float], chances: Iterable[float]) -> float:
    """Return the largest error bound of the parts of the answer [tolerances]; a choice counts by its equivalent bound.

    A choice that is right with probability p has the equivalent bound SUFFICIENT · q(CERTAIN) / q(p). There q(p) is the
    half width of the interval that contains a standard normal variable with probability p.
    """
    certain = _quantile(CERTAIN)
    found = [SUFFICIENT * certain / _quantile(chance) for chance in chances if chance < 1]
    return max([*bounds, *found], default=0.0)


def _quantile(chance: float) -> float:
    """Half width of the interval that contains a standard normal variable with a probability."""
    return NormalDist().inv_cdf((1 + max(chance, 1e-3)) / 2)


class Rival(Record):
    """A structure, or a value of a discrete constant, that is not the true one and gives a different answer."""

    name: str
    chi_square: float
    """Chi-square of its fit to all readings, minus that of the true one."""
    excluded: bool
    """Whether the readings exclude it at four standard deviations."""


class EvidenceRecord(Record):
    """A line of `evidence.jsonl`: how far the readings of one episode determine the answer."""

    format: Literal[1] = 1
    key: EpisodeKey
    episode: str
    """SHA-256 of the episode's line in `episodes.jsonl`."""
    calls: tuple[CallEvidence, ...] = ()
    """The evidence after each call that returned a new reading."""
    rivals: tuple[Rival, ...] = ()
    """The rivals after the last call."""
    not_measurable: str = ""
    """Why the evidence cannot be computed; empty if it can."""
    seconds: float = Field(default=0.0, ge=0)
    """Processor time of the computation [s]; 0 if the experiments are those of another episode, measured with it."""

    @property
    def suffices(self) -> bool:
        """Return whether all readings together determine the answer."""
        return bool(self.calls) and self.calls[-1].suffices and all(rival.excluded for rival in self.rivals)

    @property
    def sufficed_at(self) -> int | None:
        """Return the number of the call after which the evidence sufficed; None if it never did.

        `rivals` are fitted to all readings, so whether they are excluded is known only after the last call.
        """
        return next((step.call for step in self.calls if step.suffices), None) if self.suffices else None

    @property
    def worst_bound(self) -> float | None:
        """The largest bound after the last call, `rivals` included; None if nothing was read [tolerances]."""
        if not self.calls:
            return None
        possible = sum(not rival.excluded for rival in self.rivals)
        return worst_bound([self.calls[-1].worst_bound], [1 / (1 + possible)])


class EvidenceVerdict(StrEnum):
    """Whether an episode failed by its experiments or by its reasoning."""

    EARNED = "earned"
    """The answer is right, and the readings determine it."""
    GUESSED = "guessed right without evidence"
    """The answer is right, although the readings do not determine it."""
    INFERENCE_FAILED = "inference failed on sufficient evidence"
    """The answer is wrong or missing, although the readings determine it."""
    EXPERIMENT_INSUFFICIENT = "experiment insufficient"
    """The answer is wrong or missing, and the readings do not determine it."""


def evidence_verdict(evidence: EvidenceRecord, verdict: Verdict) -> EvidenceVerdict | None:
    """Return the verdict on an episode's evidence; None if the evidence is not measurable or the answer unscored."""
    if evidence.not_measurable or verdict is Verdict.UNSCORED:
        return None
    if verdict is Verdict.CORRECT:
        return EvidenceVerdict.EARNED if evidence.suffices else EvidenceVerdict.GUESSED
    return EvidenceVerdict.INFERENCE_FAILED if evidence.suffices else EvidenceVerdict.EXPERIMENT_INSUFFICIENT
