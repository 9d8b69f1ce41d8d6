"""The state of a run in progress: correct answers, money, pace."""

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from evaluator.answers.grading import grade_episode
from evaluator.answers.keys import KeyRing
from evaluator.records.episode import Episode, Verdict
from evaluator.study.run_config import Meter


@dataclass(slots=True)
class Tally:
    """Grades episodes as they end, for the display only. The verdicts that count are made after the run."""

    keys: KeyRing
    meter: Meter
    agents: Sequence[str]
    """Names of all agents of the run. Accuracies of several agents are never pooled."""
    clock: Callable[[], float] = time.monotonic
    ended: int = 0
    scored: Counter[str] = field(default_factory=Counter[str])
    """Number of scored episodes of each agent."""
    correct: Counter[str] = field(default_factory=Counter[str])
    """Number of right episodes of each agent."""
    started: float = field(init=False)

    def __post_init__(self) -> None:
        self.started = self.clock()

    def add(self, episode: Episode) -> Verdict:
        """Count an episode that has just ended, and return its verdict."""
        verdict = grade_episode(episode, self.keys.key(episode.key.scene, episode.key.seed)).strict
        self.ended += 1
        self.scored[episode.key.agent] += verdict is not Verdict.UNSCORED
        self.correct[episode.key.agent] += verdict is Verdict.CORRECT
        return verdict

    def line(self, agent: str) -> str:
        """The state of the run in a few words.

        Args:
            agent: Whose right answers are counted. It is named if the run has several agents.
        """
        minutes = max(self.clock() - self.started, 1e-9) / 60
        named = f"{agent} " if len(self.agents) > 1 else ""
        parts = [f"{named}{self.correct[agent]}/{self.scored[agent]} right"] if self.scored[agent] else []
        if self.meter.tokens:
            parts.append(f"{self.meter.tokens / 1000:.0f} k tokens")
        if self.meter.cost_usd:
            parts.append(f"${self.meter.cost_usd:.2f}")
        if self.ended:
            parts.append(f"{self.ended / minutes:.0f} episodes/min")
        return " · ".join(parts)
