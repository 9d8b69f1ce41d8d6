"""Builds scored episodes with chosen grades and failures; scores and grounding are computed as in production."""

from pydantic import JsonValue

from evaluator.answers.rewards import Chance
from evaluator.records.episode import Episode, Grade, GradeRecord
from evaluator.scores.dimensions import EpisodeScores, cost_of, dimensions
from evaluator.scores.failures.findings import Failure
from evaluator.scores.grounding import grounding_of
from evaluator.scores.scored_episode import ScoredEpisode
from scenes import LabLimits

CHANCE = Chance(0.0, 0.0)
"""The probability of a correct blind guess, here 0."""


def scores_of(episode: Episode, grade: Grade, disabled_tools: frozenset[str] = frozenset()) -> EpisodeScores:
    """Compute the dimensions of an episode, with the grounding computed from its calls."""
    return dimensions(episode, grade, grounding_of(episode), disabled_tools)


def scored(
    episode: Episode,
    grade: Grade,
    category: str = "easy-single",
    problem_type: str = "calculation",
    *,
    disabled_tools: frozenset[str] = frozenset(),
    failures: tuple[Failure, ...] = (),
    answer_key: JsonValue = 1.5,
    grader_version: str = "1",
    limits: LabLimits | None = None,
    chance: Chance = CHANCE,
) -> ScoredEpisode:
    """Build a scored episode of a scene for which there is no pack."""
    record = GradeRecord(
        key=episode.key,
        grade=grade,
        answer_key=answer_key,
        grader_version=grader_version,
        pack_version=episode.versions.pack,
    )
    return ScoredEpisode(
        episode=episode,
        record=record,
        scene_name="",
        category=category,
        problem_type=problem_type,
        scores=scores_of(episode, grade, disabled_tools),
        chance=chance,
        experiment_cost=cost_of(episode, limits or LabLimits()),
        grounding=grounding_of(episode),
        failures=failures,
    )
