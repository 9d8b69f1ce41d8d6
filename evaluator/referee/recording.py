"""What a referee counts: its episodes and refusals, in the text format of Prometheus, and the epochs of its records."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

from evaluator.certify.seed_proofs import SeedProver
from evaluator.records.episode import EpisodeKey, Outcome
from evaluator.records.run import RunRecord

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"
"""Media type of the text format."""


@dataclass(slots=True)
class Metrics:
    """Counters of a referee since its start."""

    opened: int = 0
    expired: int = 0
    """Episodes that were closed after `max_wall_s` without a request for their reward."""
    closed: int = 0
    """Episodes that the trainer closed without a reward."""
    rewards: Counter[Outcome] = field(default_factory=Counter[Outcome])
    """Graded episodes by outcome."""
    reward_sum: float = 0.0
    refused: Counter[int] = field(default_factory=Counter[int])
    """Refused requests by status."""

    def text(self, open_episodes: int, most: int) -> str:
        """Return all values in the text format.

        Args:
            open_episodes: Number of open episodes.
            most: Largest number of open episodes.
        """
        lines = [
            *_family("episodes_open", "gauge", "Episodes that are open or being opened.", {"": open_episodes}),
            *_family("episodes_limit", "gauge", "Most episodes that may be open.", {"": most}),
            *_family("episodes_opened_total", "counter", "Episodes opened.", {"": self.opened}),
            *_family("episodes_expired_total", "counter", "Episodes ended by their lease.", {"": self.expired}),
            *_family("episodes_closed_total", "counter", "Episodes closed without a reward.", {"": self.closed}),
            *_family(
                "rewards_total",
                "counter",
                "Rewards given, by outcome.",
                {f'{{outcome="{outcome.value}"}}': self.rewards[outcome] for outcome in sorted(self.rewards)},
            ),
            *_family("reward_sum", "gauge", "Sum of all rewards, which may be negative.", {"": self.reward_sum}),
            *_family(
                "refusals_total",
                "counter",
                "Refused requests, by status.",
                {f'{{status="{status}"}}': self.refused[status] for status in sorted(self.refused)},
            ),
        ]
        return "\n".join(lines) + "\n"


def _family(name: str, kind: str, words: str, samples: dict[str, float]) -> Iterator[str]:
    """Format one metric: its help text, its type, and one sample per set of labels."""
    full = f"physment_referee_{name}"
    yield f"# HELP {full} {words}"
    yield f"# TYPE {full} {kind}"
    yield from (f"{full}{labels} {value}" for labels, value in samples.items())


@dataclass(slots=True)
class Recording:
    """The episodes in the run folder of a referee."""

    splits: set[str] = field(default_factory=set[str])
    """Splits of the recorded episodes."""
    _played: Counter[tuple[int, int, int, str]] = field(default_factory=Counter[tuple[int, int, int, str]])
    """Number of records per combination of scene, seed, budget and prompting. It gives the epoch of the next record."""

    def numbered(self, key: EpisodeKey) -> EpisodeKey:
        """Return the episode key to record, with an epoch that is unique even if two are graded concurrently."""
        cell = key.scene, key.seed, key.budget, key.prompting
        self._played[cell] += 1
        return key.model_copy(update={"epoch": self._played[cell]})

    def run_record(self, record: RunRecord, prover: SeedProver | None) -> RunRecord:
        """Return a run record with a plan that contains the recorded episodes only.

        Args:
            record: The record from the start of the referee.
            prover: The object that checked the seeds; None if no seed was checked.
        """
        cells, splits = sorted(self._played), self.splits
        plan = record.plan.model_copy(
            update={
                "scenes": tuple(sorted({scene for scene, *_ in cells})),
                "seeds": tuple(sorted({seed for _, seed, *_ in cells})),
                "budgets": tuple(sorted({budget for _, _, budget, _ in cells})),
                "promptings": tuple(sorted({prompting for *_, prompting in cells})),
                "epochs": max(self._played.values(), default=1),
                # A run has one split or none. The split of held-back seeds is in the plan from the start.
                "split": record.plan.split or (next(iter(splits)) if len(splits) == 1 else ""),
            }
        )
        proofs = prover.record((scene, seed) for scene, seed, *_ in cells) if prover else None
        return record.model_copy(update={"plan": plan, "seed_proofs": proofs})
