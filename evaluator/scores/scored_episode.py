"""The record that summaries, reports and comparisons read: one episode with everything computed from it alone."""

from dataclasses import dataclass

from evaluator.answers.rewards import Chance
from evaluator.records.episode import Episode, EpisodeKey, Grade, GradeRecord, Verdict
from evaluator.records.evidence import EvidenceRecord, EvidenceVerdict, evidence_verdict
from evaluator.scores.dimensions import EpisodeScores, ExperimentCost
from evaluator.scores.errata import is_withdrawn
from evaluator.scores.failures.findings import Failure
from evaluator.scores.grounding import Grounding
from evaluator.scores.grouping import rung
from evaluator.scores.summaries import MeasuredEpisode, StatedEpisode
from scenes import Erratum, Rung, reference_of


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
