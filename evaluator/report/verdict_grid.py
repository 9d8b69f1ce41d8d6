"""The grid at the head of a report: a cell for each agent and scene, with the verdicts of its episodes."""

from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

from evaluator.records.episode import Verdict
from evaluator.report.notebook import Entry

_SYMBOLS = {"correct": "✓", "incorrect": "✗", "mixed": "±", "unscored": "–", "": ""}


class VerdictCell(NamedTuple):
    """A cell of the grid: the verdicts on the episodes of one agent in one scene."""

    state: str
    """`correct`, `incorrect`, `unscored`, or `mixed` if its scored episodes differ; empty if there is none."""
    symbol: str
    """One character for the state, so that colour is not the only distinction."""
    words: str
    """Text of the cell: scene and state, such as `28 Glider between cords: 2 of 3 correct`."""
    href: str
    """Link to the notebook of its only episode, or to the list of episodes."""
    chosen: str
    """Filter by which the list shows only the episodes of this cell; empty if the cell links to a notebook."""


def verdict_grid(entries: Sequence[Entry], agents: int) -> list[list[VerdictCell]]:
    """For each agent, a cell for each scene; the scenes are in the same order for all.

    Args:
        entries: The episodes of the report, in order of scene.
        agents: Number of agents in the report.
    """
    found: defaultdict[tuple[int, int], list[Entry]] = defaultdict(list)
    titles: dict[int, str] = {}
    for entry in entries:
        found[entry.agent_index, entry.row.key.scene].append(entry)
        titles[entry.row.key.scene] = entry.row.scene_title
    return [
        [_cell(agent, scene, title, found[agent, scene]) for scene, title in titles.items()] for agent in range(agents)
    ]


def _cell(agent: int, scene: int, title: str, played: Sequence[Entry]) -> VerdictCell:
    scored = [entry.row.is_correct for entry in played if entry.row.grade.strict is not Verdict.UNSCORED]
    if not played:
        state, words = "", "not played"
    elif not scored:
        state, words = "unscored", "unscored"
    else:
        state = "mixed" if 0 < sum(scored) < len(scored) else "correct" if scored[0] else "incorrect"
        words = state if len(played) == 1 else f"{sum(scored)} of {len(scored)} correct"
    if len(played) > 1:
        return VerdictCell(state, _SYMBOLS[state], f"{title}: {words}", "#episodes", f"scene={scene}&agent={agent}")
    return VerdictCell(state, _SYMBOLS[state], f"{title}: {words}", "".join(f"#{one.id}" for one in played), "")
