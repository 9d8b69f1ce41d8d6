"""The matrix of a run, and which of its episodes are still to be played."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import product

from evaluator.records import Episode, EpisodeKey, Outcome


@dataclass(frozen=True, slots=True)
class Plan:
    """What a run consists of: each combination once."""

    scenes: tuple[int, ...]
    agents: tuple[str, ...]
    """Names of the agents."""
    budgets: tuple[int, ...] = (20,)
    seeds: tuple[int, ...] = (0,)
    epochs: int = 1
    promptings: tuple[str, ...] = ("zero-shot",)
    protocols: tuple[str, ...] = ("native",)

    def matrix(self) -> list[EpisodeKey]:
        """All episodes of the run, in playing order: a run that is stopped early has whole epochs and budgets."""
        combinations = product(
            range(1, self.epochs + 1),
            self.budgets,
            self.promptings,
            self.protocols,
            self.agents,
            self.seeds,
            self.scenes,
        )
        return [
            EpisodeKey(
                scene=scene,
                seed=seed,
                agent=agent,
                budget=budget,
                prompting=prompting,
                protocol=protocol,
                epoch=epoch,
            )
            for epoch, budget, prompting, protocol, agent, seed, scene in combinations
        ]


def missing(keys: Iterable[EpisodeKey], done: Mapping[EpisodeKey, Episode]) -> list[EpisodeKey]:
    """Episodes still to be played: those without a record, and those that only infrastructure errors ended."""
    return [key for key in keys if key not in done or done[key].outcome is Outcome.INFRASTRUCTURE_ERROR]
