"""The results of each agent in one or several runs, and the results printed in the paper, which uses other scenes."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from evaluator.records.run import RunRecord
from evaluator.report.attachments import NOTHING, Attachments
from evaluator.scores.metrics import GroupSummary, RunSummary, summarise
from evaluator.scores.scored_episode import ScoredEpisode
from evaluator.scores.spending import Spending, spending
from scenes import content_hash_of

BUDGETS = (5, 10, 15, 20)
CATEGORIES = {
    "easy-single": "Easy Single Phys.",
    "easy-single-creation": "Easy Single + Obj.C.",
    "easy-single-hidden": "Easy Single + Hid.",
    "hard-single": "Hard Single Phys.",
    "hard-single-creation": "Hard Single + Obj.C.",
    "hard-single-hidden": "Hard Single + Hid.",
    "easy-multi": "Easy Multi",
    "easy-multi-creation": "Easy Multi + Obj.C.",
    "easy-multi-hidden": "Easy Multi + Hid.",
    "hard-multi": "Hard Multi",
    "hard-multi-creation": "Hard Multi + Obj.C.",
    "hard-multi-hidden": "Hard Multi + Hid.",
    "create-delete-attach": "Create / Del. / Att.",
}
"""Category → its name in the paper, in the order of the paper's heat map."""


@dataclass(frozen=True, slots=True)
class Quoted:
    """The results of a model, as printed in the paper."""

    model: str
    accuracy: tuple[float, ...]
    """Overall, in per cent, in the order of `BUDGETS`."""
    mean_accuracy: float
    """Over all budgets, in per cent."""
    dimensions: tuple[float, ...]
    """C, E, G, V, R, G′."""
    final_score: float
    """0 to 100."""
    by_category: tuple[float, ...]
    """Accuracy in per cent over all budgets, in the order of `CATEGORIES`."""


PAPER = (
    Quoted(
        "GPT-5.5",
        (51.4, 49.5, 48.6, 50.5),
        50.0,
        (0.583, 0.537, 0.729, 1.000, 0.701, 0.476),
        64.1,
        (80.6, 50.0, 60.0, 36.7, 0.0, 40.0, 41.7, 40.0, 85.0, 66.7, 80.0, 60.0, 18.2),
    ),
    Quoted(
        "Claude Opus 4.7",
        (40.5, 39.6, 42.3, 40.5),
        40.7,
        (0.503, 0.655, 0.544, 0.999, 0.613, 0.580),
        60.0,
        (25.0, 45.0, 25.0, 25.0, 0.0, 30.0, 21.7, 65.0, 30.0, 71.7, 50.0, 100.0, 38.6),
    ),
    Quoted(
        "DeepSeek R1",
        (42.3, 51.4, 48.6, 53.3),
        48.5,
        (0.480, 0.418, 0.514, 1.000, 0.633, 0.588),
        55.4,
        (66.7, 40.0, 45.0, 6.7, 25.0, 40.0, 31.7, 25.0, 60.0, 31.7, 25.0, 25.0, 27.3),
    ),
    Quoted(
        "GLM-5",
        (46.7, 37.7, 48.6, 48.6),
        45.2,
        (0.351, 0.238, 0.744, 1.000, 0.700, 0.426),
        50.0,
        (61.1, 25.0, 45.0, 1.7, 20.0, 35.0, 25.0, 35.0, 50.0, 46.7, 30.0, 25.0, 18.2),
    ),
    Quoted(
        "Kimi K2.5",
        (27.4, 37.1, 46.7, 56.2),
        41.9,
        (0.308, 0.201, 0.702, 0.999, 0.708, 0.381),
        46.7,
        (50.0, 20.0, 30.0, 5.0, 30.0, 20.0, 30.0, 35.0, 55.0, 40.0, 25.0, 15.0, 25.0),
    ),
    Quoted(
        "Qwen 3.5",
        (26.7, 24.8, 35.2, 27.6),
        28.6,
        (0.224, 0.280, 0.712, 1.000, 0.678, 0.432),
        44.9,
        (33.3, 5.0, 20.0, 1.7, 30.0, 0.0, 5.0, 10.0, 25.0, 23.3, 10.0, 5.0, 13.6),
    ),
    Quoted(
        "Gemini 3.1 Pro",
        (29.5, 50.4, 51.4, 66.7),
        49.5,
        (0.555, 0.420, 0.598, 1.000, 0.657, 0.437),
        58.4,
        (72.2, 55.0, 50.0, 15.0, 50.0, 40.0, 45.0, 50.0, 80.0, 58.3, 70.0, 50.0, 56.8),
    ),
)
"""Results of all models in the paper, after the authors' re-grading by their own rules."""

REGRADED = {
    "equivalent_object_notation": (15, 5),
    "trivial_rounding": (35, 10),
    "conceptual_description": (63, 11),
    "partial_answer_format": (37, 7),
}
"""Class of normalisation → number of re-graded cases in the paper and number of scenes with such cases."""


_ATTACKERS = ("attacker:sweep", "attacker:glance", "attacker:proportional")
_BASELINES = ("reference", "random", "blind", "constant", "batch", *_ATTACKERS)
"""Baseline agents, which characterise the suite. Every table lists them last, in this order."""


@dataclass(frozen=True, slots=True)
class Run:
    """A graded run, as input of a report."""

    name: str
    """Name of the run folder, or its path if two runs have the same name."""
    record: RunRecord
    rows: Sequence[ScoredEpisode]
    pictures: Mapping[int, bytes]
    """Scene → PNG image of its start state; scenes without an image are omitted."""
    attachments: Attachments = NOTHING
    """Films and frames of the run that were written beside the page of the report."""
    seal: str = ""
    """Clause about the seal of the run's records; empty if the seal was not checked."""


@dataclass(frozen=True, slots=True)
class AgentResults:
    """The results of one agent in one run under one prompting and protocol, at all budgets: one column of a report."""

    label: str
    """The agent's name, with as much of prompting, protocol and run as makes the label unique."""
    run: Run
    agent: str
    suite: Sequence[ScoredEpisode]
    """Scored episodes in all scenes except open worlds. Tables use these unless they say otherwise."""
    open_worlds: Sequence[ScoredEpisode]
    summary: RunSummary
    spending: Spending
    """Cost and effort of its episodes in the suite."""

    @property
    def rows(self) -> Sequence[ScoredEpisode]:
        """All scored episodes of the agent, open worlds included."""
        return [*self.suite, *self.open_worlds]

    @property
    def is_baseline(self) -> bool:
        """Whether the agent is a baseline, which characterises the suite and is not under test."""
        return _rank(self.agent) < len(_BASELINES)

    @property
    def is_unsealed(self) -> bool:
        """Whether the agent could have had information other than its measurements in some episode."""
        return any(row.episode.unsealed is not None for row in self.rows)

    @property
    def whole(self) -> GroupSummary:
        """Summary of its episodes in the suite, over all budgets."""
        return self.summary.overall


def agent_results(runs: Sequence[Run]) -> list[AgentResults]:
    """Collect the results of all agents in runs: agents under test by name, then the baselines."""
    found: defaultdict[tuple[int, str, str, str], list[ScoredEpisode]] = defaultdict(list)
    for index, run in enumerate(runs):
        for row in run.rows:
            found[index, row.key.agent, row.key.prompting, row.key.protocol].append(row)
    keys = sorted(found, key=lambda key: (_rank(key[1]) < len(_BASELINES), _rank(key[1]), key[1], key))
    labels = _labels(keys, runs)
    return [_results(labels[key], runs[key[0]], key[1], found[key]) for key in keys]


def packs_of(results: Sequence[AgentResults]) -> Mapping[str, str]:
    """Scene → hash of the content of its pack, for the scenes of the suite that some agents played.

    Withdrawn packs are left out.
    """
    return {
        str(row.key.scene): content_hash_of(row.episode.versions.pack)
        for result in results
        for row in result.suite
        if not row.is_withdrawn
    }


def _results(label: str, run: Run, agent: str, rows: Sequence[ScoredEpisode]) -> AgentResults:
    suite, open_worlds = [row for row in rows if not row.is_open], [row for row in rows if row.is_open]
    return AgentResults(label, run, agent, suite, open_worlds, summarise(rows), spending(suite))


def _rank(agent: str) -> int:
    """Sort key of an agent: its index among the baselines, or a larger number if it is not a baseline."""
    names = (index for index, name in enumerate(_BASELINES) if agent == name or agent.startswith(f"{name}-"))
    return next(names, len(_BASELINES))


def _labels(keys: Sequence[tuple[int, str, str, str]], runs: Sequence[Run]) -> Mapping[tuple[int, str, str, str], str]:
    """Label of each column: the agent's name, with prompting, protocol and run where these differ between columns."""
    labels: dict[tuple[int, str, str, str], str] = {}
    for key in keys:
        namesakes = [other for other in keys if other[1] == key[1] and other != key]
        differs = [index for index in (2, 3, 0) if any(other[index] != key[index] for other in namesakes)]
        parts = [runs[key[0]].name if index == 0 else str(key[index]) for index in differs]
        labels[key] = f"{key[1]} ({', '.join(parts)})" if parts else key[1]
    return labels
