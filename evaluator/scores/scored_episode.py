"""The record that reports and comparisons read for an episode; withdrawals by errata; counts of evidence and laws."""

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from statistics import median

from evaluator.answers.rewards import Chance
from evaluator.records.episode import Episode, EpisodeKey, Grade, GradeRecord, LawGrade, Outcome, Record, Verdict
from evaluator.records.evidence import EvidenceRecord, EvidenceVerdict, evidence_verdict
from evaluator.scores.dimensions import EpisodeScores, ExperimentCost
from evaluator.scores.failures.findings import Failure
from evaluator.scores.grounding import Grounding
from evaluator.scores.grouping import rung
from scenes import Erratum, ErratumEffect, Rung, reference_of

WITHDRAWN = "withdrawn: "
"""Prefix of the reason of a grade that has no verdict because of a known fault; the fault follows it."""


class AccuracyBounds(Record):
    """Bounds on the strict accuracy of a group if its withdrawn episodes had been counted, 0 to 1."""

    all_wrong: float
    """Accuracy if all withdrawn episodes were wrong."""
    all_right: float
    """Accuracy if all withdrawn episodes were right."""


class AppliedErratum(Record):
    """A known fault of a pack that episodes of a run were played on."""

    erratum: Erratum
    n: int
    """Episodes of the run that were played on the pack."""


def is_withdrawn(episode: Episode, erratum: Erratum | None) -> bool:
    """Whether an episode that would otherwise have a verdict has none because of a known fault of its pack.

    Args:
        episode: The recorded episode.
        erratum: The known fault; None if none is known.
    """
    faulty = erratum is not None and erratum.effect is ErratumEffect.WITHDRAWN
    return faulty and episode.outcome is not Outcome.INFRASTRUCTURE_ERROR


def withdrawn_grade(erratum: Erratum) -> Grade:
    """Return the grade of an episode that was played on a pack with this fault."""
    return Grade(
        strict=Verdict.UNSCORED, graded=None, normalised=Verdict.UNSCORED, reason=f"{WITHDRAWN}{erratum.fault}"
    )


def applied_errata(faults: Iterable[Erratum | None]) -> tuple[AppliedErratum, ...]:
    """Count the episodes affected by each known fault, ordered by scene.

    Args:
        faults: The known fault of the pack of each episode; None if none is known.
    """
    counts = Counter(entry for entry in faults if entry is not None)
    found = sorted(counts, key=lambda entry: (entry.scene, entry.pack))
    return tuple(AppliedErratum(erratum=entry, n=counts[entry]) for entry in found)


def accuracy_bounds(correct: int, scored: int, withdrawn: int) -> AccuracyBounds | None:
    """Return the bounds on strict accuracy that include withdrawn episodes; None if no episode is withdrawn.

    Args:
        correct: Number of strictly correct episodes.
        scored: Number of episodes with a verdict.
        withdrawn: Number of withdrawn episodes.
    """
    whole = scored + withdrawn
    return AccuracyBounds(all_wrong=correct / whole, all_right=(correct + withdrawn) / whole) if withdrawn else None


@dataclass(frozen=True, slots=True)
class MeasuredEpisode:
    """An episode whose evidence was measured, with its verdict."""

    episode: Episode
    evidence: EvidenceRecord
    verdict: Verdict
    """Strict verdict on the answer."""


class EvidenceSummary(Record):
    """Summary of the evidence of several episodes. Episodes whose evidence was not measured are not counted."""

    verdicts: dict[EvidenceVerdict, int]
    """Number of episodes with each verdict on evidence. Episodes without a verdict on the answer have none."""
    not_measurable: int
    """Number of episodes whose evidence cannot be measured."""
    answered_before: int
    """Number of episodes that were answered although their evidence did not suffice."""
    calls_until: float | None
    """Median number of calls until the evidence sufficed, over the episodes in which it did; None if in none."""
    calls_after: float | None
    """Median number of calls after the evidence sufficed, over the same episodes."""


def evidence_summary(measured: Iterable[MeasuredEpisode]) -> EvidenceSummary | None:
    """Summarise the evidence of some episodes; None if there are none."""
    found = list(measured)
    if not found:
        return None
    verdicts = Counter(evidence_verdict(one.evidence, one.verdict) for one in found)
    sufficed = [
        (at, sum(1 for _ in one.episode.accepted_calls()) - at)
        for one in found
        if (at := one.evidence.sufficed_at) is not None
    ]
    return EvidenceSummary(
        verdicts={verdict: verdicts[verdict] for verdict in EvidenceVerdict},
        not_measurable=sum(bool(one.evidence.not_measurable) for one in found),
        answered_before=sum(
            one.episode.outcome is Outcome.ANSWERED and not one.evidence.not_measurable and not one.evidence.suffices
            for one in found
        ),
        calls_until=median(at for at, _ in sufficed) if sufficed else None,
        calls_after=median(after for _, after in sufficed) if sufficed else None,
    )


@dataclass(frozen=True, slots=True)
class StatedEpisode:
    """An episode of a scene that asks for a law."""

    law: LawGrade | None
    """Grade of its law; None if it stated none."""
    verdict: Verdict
    """Strict verdict on the answer."""


class LawSummary(Record):
    """Counts of stated laws and of right answers, over episodes of scenes that ask for a law."""

    asked: int
    """Number of episodes."""
    stated: int
    """Number of episodes that stated a law."""
    known: int
    """Number of episodes whose law is equivalent to that of the laboratory."""
    predicted: int
    """Number of episodes with a right answer."""
    predicted_and_known: int
    """Number of episodes with a right answer and an equivalent law."""
    predicted_not_known: int
    """Number of episodes with a right answer and a law that is not equivalent."""
    predicted_not_stated: int
    """Number of episodes with a right answer and no law."""
    dependence_f1: float | None
    """Median F1 score of the quantities on which the stated laws depend; None if none was stated."""
    length: float | None
    """Median length of the equivalent laws; None if there is none."""


def law_summary(episodes: Iterable[StatedEpisode]) -> LawSummary | None:
    """Summarise the laws that agents wrote in some episodes; None without episodes."""
    found = list(episodes)
    if not found:
        return None
    right = [one for one in found if one.verdict is Verdict.CORRECT]
    laws = [one.law for one in found if one.law is not None]
    known = [law for law in laws if law.equivalent]
    return LawSummary(
        asked=len(found),
        stated=len(laws),
        known=len(known),
        predicted=len(right),
        predicted_and_known=sum(one.law is not None and one.law.equivalent for one in right),
        predicted_not_known=sum(one.law is not None and not one.law.equivalent for one in right),
        predicted_not_stated=sum(one.law is None for one in right),
        dependence_f1=median(law.dependence_f1 for law in laws) if laws else None,
        length=median(law.length for law in known) if known else None,
    )


def law_sentence(found: LawSummary) -> str:
    """State in a sentence how many episodes predicted correctly, and how many stated an equivalent law."""
    return (
        f"laws: stated in {found.stated} of {found.asked} episodes, equivalent in {found.known}; of {found.predicted}"
        f" that predicted, {found.predicted_and_known} knew the law, {found.predicted_not_known} stated another law and"
        f" {found.predicted_not_stated} stated none"
    )


def scene_title(scene: int, name: str) -> str:
    """Return reference and name of a scene, such as `28 Glider between cords`; for a world the reference alone."""
    reference = reference_of(scene)
    return f"{reference} {name}".rstrip() if reference.isdecimal() else reference


@dataclass(frozen=True, slots=True)
class ScoredEpisode:
    """One episode with its grade, scores, grounding and failures. Created only by `evaluator.scores.scoring`."""

    episode: Episode
    record: GradeRecord
    """Its grade, with the answer key and the grader's version."""
    scene_name: str
    """Name of its scene."""
    category: str
    """Category of its scene."""
    problem_type: str
    """Problem type of its scene."""
    scores: EpisodeScores
    chance: Chance
    """Expected scores of a blind guess in this episode."""
    experiment_cost: ExperimentCost
    grounding: Grounding
    failures: tuple[Failure, ...]
    """Empty if the episode is unscored."""
    erratum: Erratum | None = None
    """Known fault of the pack that it was played on; None if none is known."""
    evidence: EvidenceRecord | None = None
    """Evidence that its experiments provide about the answer; None if it was not measured."""
    asks_for_law: bool = False
    """Whether its scene asks for a law with the answer."""

    @property
    def key(self) -> EpisodeKey:
        """Scene, seed, agent and settings of the episode."""
        return self.episode.key

    @property
    def grade(self) -> Grade:
        """The verdicts on its answer."""
        return self.record.grade

    @property
    def scene_title(self) -> str:
        """Reference and name of the scene, such as `28 Glider between cords`; for a world the reference alone."""
        return scene_title(self.key.scene, self.scene_name)

    @property
    def rung(self) -> str:
        """Rung of the scene: `easy`, `hard`, `open`, or `NO_RUNG`."""
        return rung(self.category)

    @property
    def is_open(self) -> bool:
        """Whether the scene is an open world, which is excluded from all scores of the suite."""
        return self.rung == Rung.OPEN

    @property
    def is_scored(self) -> bool:
        """Whether the episode has a verdict. It has none after an infrastructure error, or if its pack is withdrawn."""
        return self.grade.strict is not Verdict.UNSCORED

    @property
    def evidence_verdict(self) -> EvidenceVerdict | None:
        """Verdict on the experiments and the reasoning; None if the evidence was not measured or is not measurable."""
        return None if self.evidence is None else evidence_verdict(self.evidence, self.grade.strict)

    @property
    def measured(self) -> MeasuredEpisode | None:
        """The episode with its evidence and verdict; None if the evidence was not measured."""
        return None if self.evidence is None else MeasuredEpisode(self.episode, self.evidence, self.grade.strict)

    @property
    def stated(self) -> StatedEpisode | None:
        """Grade of the law that the agent wrote, and verdict on its answer; None if the scene asks for no law."""
        return StatedEpisode(self.record.law, self.grade.strict) if self.asks_for_law else None

    @property
    def is_withdrawn(self) -> bool:
        """Whether the episode has no verdict because of a known fault of its pack."""
        return is_withdrawn(self.episode, self.erratum)

    @property
    def is_correct(self) -> bool:
        """Whether its answer is strictly correct."""
        return self.grade.strict is Verdict.CORRECT
