"""Who stands side by side in a report: each agent of each run under one prompting and protocol. Reads no files."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from evaluator.records import EpisodeKey, GradeRecord, RunRecord
from evaluator.scores.metrics import GroupSummary, RunSummary, ScoredEpisode, summarise
from evaluator.scores.spending import Spending, spending

_BASELINES = ("reference", "random", "blind")
"""Agents that are no test of anything but the suite, in the order in which they close every table."""


@dataclass(frozen=True, slots=True)
class Run:
    """A run folder as reports take it."""

    name: str
    """What tells it from others: the name of its folder."""
    record: RunRecord
    rows: Sequence[ScoredEpisode]
    grades: Mapping[EpisodeKey, GradeRecord]
    pictures: Mapping[int, bytes]
    """Scene → PNG of its start; scenes without one are left out."""


@dataclass(frozen=True, slots=True)
class Contender:
    """One agent of one run under one prompting and protocol, and its numbers at all budgets."""

    label: str
    """The least that tells it from the others."""
    run: Run
    agent: str
    rows: Sequence[ScoredEpisode]
    summary: RunSummary
    spending: Spending

    @property
    def is_baseline(self) -> bool:
        """Whether it tells of the suite rather than of an agent."""
        return _rank(self.agent) < len(_BASELINES)

    @property
    def is_unsealed(self) -> bool:
        """Whether some of its episodes were open to more than was measured in them."""
        return any(row.episode.unsealed is not None for row in self.rows)

    @property
    def whole(self) -> GroupSummary:
        """Its numbers over all budgets."""
        return self.summary.overall


def contenders(runs: Sequence[Run]) -> list[Contender]:
    """The contenders of some runs: agents under test by name, then the baselines."""
    found: defaultdict[tuple[int, str, str, str], list[ScoredEpisode]] = defaultdict(list)
    for index, run in enumerate(runs):
        for row in run.rows:
            key = row.episode.key
            found[index, key.agent, key.prompting, key.protocol].append(row)
    keys = sorted(found, key=lambda one: (_rank(one[1]) < len(_BASELINES), _rank(one[1]), one[1], one))
    labels = _labels(keys, runs)
    return [
        Contender(labels[key], runs[key[0]], key[1], found[key], summarise(found[key]), spending(found[key]))
        for key in keys
    ]


def _rank(agent: str) -> int:
    """Which baseline an agent is; their number if it is none."""
    names = (index for index, name in enumerate(_BASELINES) if agent == name or agent.startswith(f"{name}-"))
    return next(names, len(_BASELINES))


def _labels(keys: Sequence[tuple[int, str, str, str]], runs: Sequence[Run]) -> Mapping[tuple[int, str, str, str], str]:
    """The agent alone where that is enough; else what it differs in from others of its name too."""
    labels: dict[tuple[int, str, str, str], str] = {}
    for key in keys:
        rivals = [other for other in keys if other[1] == key[1] and other != key]
        differs = [index for index in (2, 3, 0) if any(other[index] != key[index] for other in rivals)]
        told = [runs[key[0]].name if index == 0 else str(key[index]) for index in differs]
        labels[key] = f"{key[1]} ({', '.join(told)})" if told else key[1]
    return labels
