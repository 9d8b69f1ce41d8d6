"""A static HTML leaderboard of submissions. Ranks stored results and computes no scores.

Each agent of each submission has a row, with separate columns for the model and its scaffold.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from jinja2 import Environment, PackageLoader, StrictUndefined
from pydantic import JsonValue

from evaluator.records.run import RunRecord
from evaluator.scores.metrics import GroupSummary, RunSummary


class BoardEntry(NamedTuple):
    """The data of a submission that the page shows."""

    file: str
    """Name of its file."""
    run: RunRecord
    summary: RunSummary
    seal_head: str
    unsealed_episodes: int


class BoardRow(NamedTuple):
    """One agent of one submission."""

    agent: str
    model: str
    """Provider and model; empty if the agent is not a language model or does not name one."""
    scaffold: str
    """Everything around the model: protocol, prompting, stopping advice and presentation."""
    scores: GroupSummary
    entry: BoardEntry


class Track(NamedTuple):
    """Rows that were played on the same variants and can be ranked together, best first."""

    title: str
    rows: tuple[BoardRow, ...]

    def rank(self, row: BoardRow) -> int:
        """Rank of a row: by Skill, then by accuracy. Rows with equal scores have the same rank."""
        return 1 + sum(_score(other) > _score(row) for other in self.rows)


def tracks_of(entries: Sequence[BoardEntry]) -> list[Track]:
    """Group the agents of submissions by the variants that they played, because only these can be ranked.

    Within a track, agents are ordered by Skill, then by strict accuracy.
    """
    tracks: dict[tuple[object, ...], list[BoardRow]] = {}
    for entry in entries:
        for agent, scores in entry.summary.by_agent.items():
            row = BoardRow(agent, _model(entry.run.agents.get(agent, {})), _scaffold(entry.run, agent), scores, entry)
            tracks.setdefault(_variants(entry), []).append(row)
    return [
        Track(_title(rows[0].entry), tuple(sorted(rows, key=_order)))
        for _, rows in sorted(tracks.items(), key=lambda track: -len(track[1][0].entry.run.plan.scenes))
    ]


def _variants(entry: BoardEntry) -> tuple[object, ...]:
    """Return the ranking key of a submission: only submissions with equal keys are ranked together."""
    plan, packs = entry.run.plan, entry.run.content_hashes()
    variants = frozenset((key.scene, key.seed) for key in plan.matrix())
    return (variants, frozenset(packs.items()), plan.budgets, plan.held_back, entry.summary.scoring_version)


def _title(entry: BoardEntry) -> str:
    plan = entry.run.plan
    budgets = ", ".join(map(str, plan.budgets))
    seeds = f"{len(plan.seeds)} {'held-back ' if plan.held_back else ''}seed{'s' if len(plan.seeds) > 1 else ''}"
    scenes = f"{len(plan.scenes)} scene{'s' if len(plan.scenes) > 1 else ''}"
    where = f" of {plan.split}" if plan.split else ""
    return f"{scenes} × {seeds}{where}, budget {budgets}, scoring version {entry.summary.scoring_version}"


def _score(row: BoardRow) -> tuple[float, float]:
    skill, accuracy = row.scores.skill, row.scores.strict_accuracy
    return (-math.inf if skill is None else skill, accuracy or 0.0)


def _order(row: BoardRow) -> tuple[float, float, str]:
    skill, accuracy = _score(row)
    return (-skill, -accuracy, row.agent)


def _model(facts: Mapping[str, JsonValue]) -> str:
    match facts:
        case {"provider": str(provider), "model": str(model)}:
            return f"{provider}: {model}"
        case {"model": str(model)}:
            return model
        case _:
            return ""


def _scaffold(run: RunRecord, agent: str) -> str:
    """Describe the conditions of an agent other than its model."""
    plan = run.plan
    kind = "external program" if agent.startswith("external") else "evaluator's loop"
    parts = [kind, *plan.promptings, *(f"{name} calls" for name in plan.protocols)]
    parts += [agent.partition("+")[2]] if "+" in agent else []
    parts += [f"presentation {', '.join(plan.presentation)}"] if plan.presentation else []
    parts += [f"observations {plan.observations}"] if plan.observations != "text" else []
    return ", ".join(parts)


def board_page(title: str, tracks: Sequence[Track]) -> str:
    """Render the page as one self-contained HTML file."""
    environment = Environment(
        loader=PackageLoader("evaluator.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("board.html.j2").render(title=title, tracks=tracks)
