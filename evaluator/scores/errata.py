"""What the known faults of packs do to the verdicts of a run."""

from collections import Counter
from collections.abc import Iterable

from evaluator.records.episode import Episode, Grade, Outcome, Record, Verdict
from scenes import Erratum, ErratumEffect

WITHDRAWN = "withdrawn: "
"""Start of the reason of a grade without verdict because of a known fault; the fault follows."""


class AccuracyBounds(Record):
    """The strict accuracy of a group, had its withdrawn episodes counted, 0 to 1."""

    all_wrong: float
    """If all of them were wrong."""
    all_right: float
    """If all of them were right."""


class AppliedErratum(Record):
    """A known fault of a pack that episodes of a run were played on."""

    erratum: Erratum
    n: int
    """Episodes of the run that were played on the pack."""


def is_withdrawn(episode: Episode, erratum: Erratum | None) -> bool:
    """Whether a known fault of its pack takes the verdict from an episode, which would else have one.

    Args:
        episode: As recorded.
        erratum: The known fault; None if none is known.
    """
    faulty = erratum is not None and erratum.effect is ErratumEffect.WITHDRAWN
    return faulty and episode.outcome is not Outcome.INFRASTRUCTURE_ERROR


def withdrawn_grade(erratum: Erratum) -> Grade:
    """The grade of an episode that was played on a pack with this fault."""
    return Grade(
        strict=Verdict.UNSCORED, graded=None, normalised=Verdict.UNSCORED, reason=f"{WITHDRAWN}{erratum.fault}"
    )


def applied_errata(faults: Iterable[Erratum | None]) -> tuple[AppliedErratum, ...]:
    """The known faults of the packs of some episodes, by scene, with the number of episodes.

    Args:
        faults: The known fault of the pack of each episode; None if none is known.
    """
    counts = Counter(entry for entry in faults if entry is not None)
    found = sorted(counts, key=lambda entry: (entry.scene, entry.pack))
    return tuple(AppliedErratum(erratum=entry, n=counts[entry]) for entry in found)


def accuracy_bounds(correct: int, scored: int, withdrawn: int) -> AccuracyBounds | None:
    """The least and the greatest strict accuracy with the withdrawn episodes; None if there are none.

    Args:
        correct: Correct episodes.
        scored: Episodes with a verdict.
        withdrawn: Episodes that are withdrawn.
    """
    whole = scored + withdrawn
    return AccuracyBounds(all_wrong=correct / whole, all_right=(correct + withdrawn) / whole) if withdrawn else None
