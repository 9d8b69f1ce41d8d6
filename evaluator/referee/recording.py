"""Numbers the epochs of a referee's episodes, and writes the run record of these episodes."""

from collections import Counter
from dataclasses import dataclass, field

from evaluator.certify.seed_proofs import SeedProver
from evaluator.records.episode import EpisodeKey
from evaluator.records.run import RunRecord


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
