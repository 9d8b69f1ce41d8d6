"""Grades an episode from the log that the laboratory kept of it. Runs where no agent has been."""

from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from evaluator.agents.external.watched import outcome_of, turns_of_log
from evaluator.answers.grading import grade, grade_missing
from evaluator.answers.keys import KeyRing
from evaluator.errors import UsageError
from evaluator.records import Outcome, Verdict


class TaskEpisode(BaseModel):
    """`episode.json`: what the laboratory of a task opens, and what its log is graded for."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    scene: int
    seed: int
    max_calls: int


def rewards(log: Path, episode: Path, keys: KeyRing) -> dict[str, float]:
    """The rewards of a task, by name.

    Args:
        log: The log of the laboratory, as a host publishes it.
        episode: The `episode.json` of the task.
        keys: The answer keys.

    Returns:
        `reward` and `strict`: 1 if the answer is strictly correct, otherwise 0; `normalised`: the same, if a slip of
        writing is forgiven; `graded`: the share of its parts that are right; `answered`; `calls`.

    Raises:
        UsageError: A file cannot be read, or the scene has no key.
    """
    try:
        wanted = TaskEpisode.model_validate_json(episode.read_bytes())
    except (OSError, ValidationError) as error:
        raise UsageError(f"{episode} is no episode.json of a task: {_first(error)}") from error
    try:
        turns = turns_of_log(log.read_bytes())
    except (OSError, ValidationError) as error:
        raise UsageError(f"{log} is no log of calls: {_first(error)}; the laboratory wrote none") from error
    outcome, answer = outcome_of(turns, wanted.max_calls)
    key = keys.key(wanted.scene, wanted.seed)
    found = grade(answer, key) if outcome is Outcome.ANSWERED else grade_missing(Outcome.BUDGET_EXHAUSTED)
    strict = float(found.strict is Verdict.CORRECT)
    return {
        "reward": strict,
        "strict": strict,
        "normalised": float(found.normalised is Verdict.CORRECT),
        "graded": found.graded or 0.0,
        "answered": float(outcome is Outcome.ANSWERED),
        "calls": float(len(turns)),
    }


def _first(error: OSError | ValidationError) -> str:
    return error.errors()[0]["msg"] if isinstance(error, ValidationError) else str(error.strerror)
