"""What a report shows side by side: the results of each agent in each run, under each prompting and protocol."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from evaluator.records.episode import EpisodeKey, EvidenceRecord
from evaluator.records.run import RunRecord
from evaluator.report.attachments import NOTHING, Attachments
from evaluator.scores.metrics import GroupSummary, RunSummary, summarise
from evaluator.scores.scored_episode import ScoredEpisode
from evaluator.scores.spending import Spending, spending
from scenes import content_hash_of

_ATTACKERS = ("attacker:sweep", "attacker:glance", "attacker:proportional")
_BASELINES = ("reference", "random", "blind", "constant", "batch", *_ATTACKERS)
"""Agents that measure the suite and not an ability, in the order in which every table ends with them."""


@dataclass(frozen=True, slots=True)
class Run:
    """A graded run, as reports read it."""

    name: str
    """Name of its folder, or the path where two runs share a name."""
    record: RunRecord
    rows: Sequence[ScoredEpisode]
    pictures: Mapping[int, bytes]
    """Scene → PNG of its start; scenes without a picture are left out."""
    attachments: Attachments = NOTHING
    """Its films and frames beside the page of the report."""
    seal: str = ""
    """What the seal of its records says; empty if it was not asked."""
    evidence: Mapping[EpisodeKey, EvidenceRecord] = field(default_factory=dict[EpisodeKey, EvidenceRecord])
    """What its experiments could tell, as far as it was measured."""


@dataclass(frozen=True, slots=True)
class AgentResults:
    """The results of one agent in one run under one prompting and protocol, at all budgets: one column of a report."""

    label: str
    """The agent's name, with as much of prompting, protocol and run as makes the label unique."""
    run: Run
    agent: str
    suite: Sequence[ScoredEpisode]
    """Its episodes in all scenes but open worlds; the tables are about these unless they say otherwise."""
    open_worlds: Sequence[ScoredEpisode]
    summary: RunSummary
    spending: Spending
    """Of its episodes in the suite."""

    @property
    def rows(self) -> Sequence[ScoredEpisode]:
        """All its episodes."""
        return [*self.suite, *self.open_worlds]

    @property
    def is_baseline(self) -> bool:
        """Whether the agent is a baseline, which says something about the suite and nothing about an ability."""
        return _rank(self.agent) < len(_BASELINES)

    @property
    def is_unsealed(self) -> bool:
        """Whether the agent could have known more than it measured in some of its episodes."""
        return any(row.episode.unsealed is not None for row in self.rows)

    @property
    def whole(self) -> GroupSummary:
        """Its numbers in the suite, over all budgets."""
        return self.summary.overall


def agent_results(runs: Sequence[Run]) -> list[AgentResults]:
    """The results in some runs: agents under test by name, then the baselines."""
    found: defaultdict[tuple[int, str, str, str], list[ScoredEpisode]] = defaultdict(list)
    for index, run in enumerate(runs):
        for row in run.rows:
            found[index, row.key.agent, row.key.prompting, row.key.protocol].append(row)
    keys = sorted(found, key=lambda key: (_rank(key[1]) < len(_BASELINES), _rank(key[1]), key[1], key))
    labels = _labels(keys, runs)
    return [_results(labels[key], runs[key[0]], key[1], found[key]) for key in keys]


def packs_of(results: Sequence[AgentResults]) -> Mapping[str, str]:
    """Scene → hash of the content of its pack, for the scenes of the suite that some agents played."""
    return {
        str(row.key.scene): content_hash_of(row.episode.versions.pack) for result in results for row in result.suite
    }


def _results(label: str, run: Run, agent: str, rows: Sequence[ScoredEpisode]) -> AgentResults:
    suite, open_worlds = [row for row in rows if not row.is_open], [row for row in rows if row.is_open]
    return AgentResults(label, run, agent, suite, open_worlds, summarise(rows), spending(suite))


def _rank(agent: str) -> int:
    """Index of the baseline that an agent is; the number of baselines if it is none."""
    names = (index for index, name in enumerate(_BASELINES) if agent == name or agent.startswith(f"{name}-"))
    return next(names, len(_BASELINES))


def _labels(keys: Sequence[tuple[int, str, str, str]], runs: Sequence[Run]) -> Mapping[tuple[int, str, str, str], str]:
    """The agent's name, with each of prompting, protocol and run in which another agent of that name differs."""
    labels: dict[tuple[int, str, str, str], str] = {}
    for key in keys:
        namesakes = [other for other in keys if other[1] == key[1] and other != key]
        differs = [index for index in (2, 3, 0) if any(other[index] != key[index] for other in namesakes)]
        parts = [runs[key[0]].name if index == 0 else str(key[index]) for index in differs]
        labels[key] = f"{key[1]} ({', '.join(parts)})" if parts else key[1]
    return labels
