"""Tests of the table of episodes: which columns it has, and that it fits into a narrow terminal."""

import io
import re
from collections.abc import Sequence

import pytest
from rich.console import Console

from evaluator.answers.keys import KeyRing
from evaluator.commands.terminal import ProgressDisplay, Tally, print_results
from evaluator.records.episode import Outcome
from evaluator.scores.metrics import summarise
from evaluator.scores.scored_episode import ScoredEpisode
from evaluator.scores.scoring import GradedRun
from evaluator.study.meter import Meter
from tests.builders.records import episode, episode_key, grade, returned, turn
from tests.builders.scored import scored

REASON = "0.751757 is outside 0.3924 of 7.848"


def row(outcome: Outcome = Outcome.ANSWERED, **key: object) -> ScoredEpisode:
    played = episode(turn("", returned("answer")), key=episode_key(**key), answer=[35.622, 0.55692], outcome=outcome)  # type: ignore[arg-type]
    return scored(played, grade(False, reason=REASON), "easy-single", "calculation")


def printed(rows: Sequence[ScoredEpisode], width: int) -> list[str]:
    """The lines of the table."""
    console = Console(file=io.StringIO(), width=width)
    print_results(console, GradedRun(rows, summarise(rows), ()))
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue().splitlines()


@pytest.mark.parametrize(
    ("rows", "columns"),
    [
        pytest.param([row(), row(seed=1)], "scene seed iterations answer reason", id="all alike"),
        pytest.param([row(), row(agent="blind")], "agent scene seed iterations answer reason", id="agents"),
        pytest.param([row(), row(budget=5)], "scene seed budget iterations answer reason", id="budgets"),
        pytest.param(
            [row(), row(Outcome.BUDGET_EXHAUSTED, seed=1)], "scene seed iterations outcome answer reason", id="outcomes"
        ),
        pytest.param([row(Outcome.AGENT_ERROR)], "scene seed iterations outcome answer reason", id="never answered"),
    ],
)
def test_a_column_that_says_the_same_of_all_episodes_is_left_out(rows: list[ScoredEpisode], columns: str) -> None:
    assert printed(rows, 160)[0].split() == columns.split()


@pytest.mark.parametrize("width", [80, 100, 160])
def test_answers_and_titles_are_whole_and_reasons_keep_their_words_in_any_terminal(width: int) -> None:
    lines = printed([row(agent="reference"), row(agent="blind")], width)
    table = lines[: next(place for place, line in enumerate(lines) if "accuracy" in line)]
    assert max(map(len, table)) <= width
    assert {"agent", "scene", "seed", "iterations", "answer", "reason"} <= set(table[0].split())
    assert sum("35.622, 0.55692" in line for line in table) == 2
    words = re.findall(r"\S+", " ".join(line[table[0].index("reason") :] for line in table[1:]))
    assert words == REASON.split() * 2


def test_progress_cuts_neither_counts_nor_times_in_a_terminal_of_80_columns() -> None:
    console = Console(file=io.StringIO(), width=80, force_terminal=True)
    tally = Tally(KeyRing(), Meter(), ["random", "constant"], clock=iter(range(100)).__next__)
    with ProgressDisplay(console, 3150, tally) as display:
        display.started(episode_key(scene=111))
        display.ended(episode(turn("", returned("answer")), key=episode_key(scene=111, agent="random"), answer=1.0))
    assert isinstance(console.file, io.StringIO)
    shown = re.sub(r"\x1b\[[\d;?]*[A-Za-z]", "", console.file.getvalue())
    assert "…" not in shown
    assert re.search(r"scene 111, seed 0 +1/3150 +\S+ random 0/1 right · \d+ episodes/min", shown), shown
