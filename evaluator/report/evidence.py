"""Evidence in reports: a table of verdicts, a scatter plot for each agent, and a chart for each episode."""

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from statistics import median
from typing import NamedTuple

from evaluator.records.evidence import SUFFICIENT, EvidenceVerdict
from evaluator.report.agent_results import AgentResults
from evaluator.report.charts import LEFT, RIGHT, Chart, Point, Series, Tick, chart
from evaluator.report.tables import Cell, Table
from evaluator.scores.scored_episode import ScoredEpisode, evidence_summary

NOT_MEASURABLE = "not measurable"
_LEAST, _MOST = 1e-3, 1e2
"""Range of the charts; bounds outside it are drawn at its ends [tolerances]."""
_REFERENCE = "reference"


def verdict_of(row: ScoredEpisode) -> str:
    """The verdict on the evidence of an episode, `NOT_MEASURABLE`, or an empty text if it was not measured."""
    if row.evidence is None:
        return ""
    return NOT_MEASURABLE if row.evidence.not_measurable else str(row.evidence_verdict or "")


def evidence_table(results: Sequence[AgentResults]) -> Table | None:
    """Table of the verdicts on evidence of each agent; None if no evidence was measured."""
    needed = _reference_calls(results)
    rows: list[list[Cell]] = []
    for result in results:
        found = evidence_summary(row.measured for row in result.rows if row.measured)
        if found is None:
            continue
        shares = [
            row.evidence.sufficed_at / needed[_task(result, row)]
            for row in result.rows
            if row.evidence and row.evidence.sufficed_at and _task(result, row) in needed
        ]
        counts = (*found.verdicts.values(), found.not_measurable, found.answered_before)
        rows.append([result.label, *counts, found.calls_until, median(shares) if shares else None, found.calls_after])
    columns = ("agent", *map(str, EvidenceVerdict), NOT_MEASURABLE, "answers given before the evidence")
    columns += ("calls until it sufficed", "times the reference's", "calls after it sufficed")
    title = "Were the experiments at fault, or the reasoning?"
    return Table("evidence", title, columns, rows, decimals=1) if rows else None


_Task = tuple[str | None, int, int]


def _task(result: AgentResults, row: ScoredEpisode) -> _Task:
    """Return seed commitment, scene and seed of an episode. Equal values mean the same variant."""
    return result.run.record.plan.held_back, row.key.scene, row.key.seed


def _reference_calls(results: Iterable[AgentResults]) -> Mapping[_Task, int]:
    """Return, for each task, the number of calls after which the evidence of the reference agent sufficed."""
    return {
        _task(result, row): row.evidence.sufficed_at
        for result in results
        if result.agent == _REFERENCE
        for row in result.rows
        if row.evidence and row.evidence.sufficed_at
    }


def evidence_charts(row: ScoredEpisode) -> list[Chart]:
    """Chart the largest error bound against the number of calls, on a logarithmic scale; no chart without a reading."""
    found = row.evidence
    if found is None or not found.calls:
        return []
    points = [Point(step.call, _clipped(step.worst_bound)) for step in found.calls]
    level = math.log10(SUFFICIENT)
    made, numbers = 0, list[int]()
    accepted = {id(exchange) for _, exchange in row.episode.accepted_calls()}
    for turn in row.episode.turns:
        for exchange in turn.exchanges:
            made += id(exchange) in accepted
            numbers.append(made)
    last = max(made, points[-1].x)
    lines = [Series("bound", [points]), Series(f"{SUFFICIENT:g}: sufficient", [[Point(0, level), Point(last, level)]])]
    at = found.sufficed_at
    return [
        chart(
            "smallest standard error of the answer [tolerances] against calls",
            lines,
            size=(400, 160),
            decades=True,
            flag=None if at is None else (at, f"sufficed at call {at}"),
            calls=numbers,
        )
    ]


def _clipped(bound: float) -> float:
    return math.log10(min(max(bound, _LEAST), _MOST))


class Dot(NamedTuple):
    """An episode as a dot in the scatter plot of its agent."""

    x: float
    y: float
    verdict: EvidenceVerdict
    number: int
    """Number of the episode in the report."""
    title: str


class Plane(NamedTuple):
    """The scatter plot of an agent: episodes by evidence, increasing to the right, and by verdict.

    Coordinates in px.
    """

    label: str
    ticks: Sequence[Tick]
    sufficient: float
    dots: Sequence[Dot]
    left_out: int
    """Number of episodes whose evidence cannot be measured."""


PLANE = (430.0, 250.0)
"""Width and height of a scatter plot [px]."""
_LANES = {True: 118.0, False: 222.0}
"""y coordinate of the lowest dots of right answers (True) and of wrong answers (False) [px]."""
_LANE = 84.0
_DOT = 9.0
"""Distance between neighbouring dots [px]."""


def planes(results: Sequence[AgentResults], numbered: Iterable[tuple[int, int, ScoredEpisode]]) -> list[Plane]:
    """Lay out a scatter plot for each agent with measured evidence.

    Args:
        results: The results of all agents.
        numbered: For each episode its number in the report, the index of its agent, and the episode.
    """
    by_agent: defaultdict[int, list[tuple[int, ScoredEpisode]]] = defaultdict(list)
    for number, agent, row in numbered:
        if row.evidence is not None:
            by_agent[agent].append((number, row))
    bounds = (_MOST, 10.0, 1.0, 0.1, 0.01, _LEAST)
    ticks = [Tick(_across(None), "none"), *(Tick(_across(bound), f"{bound:g}") for bound in bounds)]
    return [
        Plane(
            results[agent].label,
            ticks,
            _across(SUFFICIENT),
            _dots(rows),
            sum(bool(row.evidence and row.evidence.not_measurable) for _, row in rows),
        )
        for agent, rows in sorted(by_agent.items())
    ]


def _across(bound: float | None) -> float:
    """Return the x coordinate of an error bound [px]; the left end for None, an episode without a reading."""
    decades = math.log10(_MOST / _LEAST) + 1
    place = 0.0 if bound is None else 1 + math.log10(_MOST) - _clipped(bound)
    return round(LEFT + _DOT + place / decades * (PLANE[0] - LEFT - RIGHT - 2 * _DOT), 1)


def _dots(rows: Sequence[tuple[int, ScoredEpisode]]) -> list[Dot]:
    """Lay out the dots of one scatter plot; dots that would overlap are stacked."""
    stacks: defaultdict[tuple[bool, int], list[tuple[int, ScoredEpisode, EvidenceVerdict]]] = defaultdict(list)
    for number, row in rows:
        if row.evidence is not None and (verdict := row.evidence_verdict) is not None:
            column = int((_across(row.evidence.worst_bound) - LEFT) // _DOT)
            # No column mixes dots from both sides of the threshold for sufficient evidence.
            limit = int((_across(SUFFICIENT) - LEFT) // _DOT)
            column = max(column, limit + 1) if row.evidence.suffices else min(column, limit - 1)
            stacks[row.is_correct, column].append((number, row, verdict))
    found: list[Dot] = []
    for (right, column), stack in sorted(stacks.items()):
        height = min(_DOT, _LANE / len(stack))
        for level, (number, row, verdict) in enumerate(stack):
            at = round(LEFT + (column + 0.5) * _DOT, 1), round(_LANES[right] - level * height, 1)
            found.append(Dot(*at, verdict, number, f"{row.scene_title}, {row.key.seed}: {verdict}"))
    return found
