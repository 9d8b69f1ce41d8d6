"""Counts the episodes that show each failure mode. Pure functions."""

from collections.abc import Iterable

from evaluator.records.episode import Grade, Record, Verdict
from evaluator.scores.failures.findings import Failure, FailureMode


class FailureCount(Record):
    """How many episodes show a failure mode. An episode may show several, so the counts may overlap."""

    n: int
    """Among the scored episodes."""
    n_incorrect: int
    """Among the strictly incorrect episodes."""


def failure_counts(episodes: Iterable[tuple[Grade, tuple[Failure, ...]]]) -> dict[FailureMode, FailureCount]:
    """Count each mode over the scored episodes. Every mode has an entry, also with a count of 0.

    Args:
        episodes: The grade and the failures of each episode.
    """
    shown = [
        (failure.mode, grade.strict is Verdict.INCORRECT)
        for grade, failures in episodes
        if grade.strict is not Verdict.UNSCORED
        for failure in failures
    ]
    return {
        mode: FailureCount(
            n=sum(found is mode for found, _ in shown),
            n_incorrect=sum(found is mode and incorrect for found, incorrect in shown),
        )
        for mode in FailureMode
    }
