"""How often each failure mode shows, over many episodes. Pure."""

from collections.abc import Iterable

from evaluator.failures.findings import Failure, FailureMode
from evaluator.records import Grade, Record, Verdict


class FailureCount(Record):
    """How many episodes show a failure mode. An episode may show several, so counts do not add up to a whole."""

    n: int
    """Of the scored episodes."""
    n_incorrect: int
    """Of the strictly incorrect ones."""


def failure_counts(episodes: Iterable[tuple[Grade, tuple[Failure, ...]]]) -> dict[FailureMode, FailureCount]:
    """Counts over episodes, unscored ones left out; every mode is there, be it with 0.

    Args:
        episodes: The grade and the failures of each.
    """
    shown = [
        (failure.mode, grade.strict is Verdict.INCORRECT)
        for grade, failures in episodes
        if grade.strict is not Verdict.UNSCORED
        for failure in failures
    ]
    return {
        mode: FailureCount(
            n=sum(one is mode for one, _ in shown),
            n_incorrect=sum(one is mode and incorrect for one, incorrect in shown),
        )
        for mode in FailureMode
    }
