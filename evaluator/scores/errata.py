"""Applies the known faults of packs to the verdicts of a run."""

from collections import Counter
from collections.abc import Iterable

from evaluator.records.episode import Episode, Grade, Outcome, Record, Verdict
from scenes import Erratum, ErratumEffect

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
