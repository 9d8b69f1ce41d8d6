"""Tests that commands read each file once and score each episode once."""

import io
import shutil
import sys
from collections import Counter
from pathlib import Path

import pytest

from evaluator.commands.program import main
from evaluator.scores.failures.detect import failures_of
from evaluator.scores.grounding import grounding_of
from evaluator.scores.scoring import grade_record
from evaluator.store.run_folder import RunFolder
from tests.builders.counting import calls_counted

EPISODES = 4
"""Two scenes, two budgets."""
MATRIX = ("--agent", "blind", "--scenes", "7,12", "--budgets", "5,20")


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory, host_url: str) -> Path:
    """A graded run that no test changes."""
    folder = tmp_path_factory.mktemp("stored") / "run"
    assert main(["run", *MATRIX, "--server", host_url, "--out", str(folder)]) == 0
    return folder


@pytest.fixture
def run(stored: Path, tmp_path: Path) -> Path:
    """A copy of that run."""
    return Path(shutil.copytree(stored, tmp_path / "run"))


def work_of(*words: str | Path) -> Counter[str]:
    """Count the calls of scoring functions by a command: function → calls."""
    with calls_counted(grounding_of, failures_of, grade_record, RunFolder.episodes, RunFolder.grades) as calls:
        assert main([str(word) for word in words]) == 0
    return calls


def test_the_counter_sees_every_call(stored: Path) -> None:
    with calls_counted(RunFolder.episodes) as calls:
        RunFolder(stored).episodes()
        RunFolder(stored).episodes()
    assert calls == {"RunFolder.episodes": 2}


def test_a_run_scores_each_episode_once(tmp_path: Path, host_url: str) -> None:
    assert work_of("run", *MATRIX, "--server", host_url, "--out", tmp_path / "run") == {
        "grounding_of": EPISODES,
        "failures_of": EPISODES,
        "grade_record": EPISODES,
        # Once before the first episode, to find what a resumed run still lacks, and once to score.
        "RunFolder.episodes": 2,
        "RunFolder.grades": 1,
    }


def test_grading_again_scores_each_episode_once(run: Path) -> None:
    assert work_of("grade", run) == {
        "grounding_of": EPISODES,
        "failures_of": EPISODES,
        "grade_record": EPISODES,
        "RunFolder.episodes": 1,
        "RunFolder.grades": 1,
    }


@pytest.mark.parametrize("more", [(), ("--export", "md"), ("--export", "csv", "--figures", "svg")])
def test_a_report_scores_each_episode_once_and_grades_none(run: Path, more: tuple[str, ...]) -> None:
    assert work_of("report", run, *more) == {
        "grounding_of": EPISODES,
        "failures_of": EPISODES,
        "RunFolder.episodes": 1,
        "RunFolder.grades": 1,
    }


def test_a_comparison_scores_each_episode_of_both_runs_once_and_grades_none(run: Path, stored: Path) -> None:
    assert work_of("compare", run, stored) == {
        "grounding_of": 2 * EPISODES,
        "failures_of": 2 * EPISODES,
        "RunFolder.episodes": 2,
        "RunFolder.grades": 2,
    }


def test_an_episode_that_a_person_plays_is_scored_once(
    tmp_path: Path, host_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO("step 0.8; get_velocity 1\nanswer 7.848\n"))
    assert work_of("play", "7", "--server", host_url, "--out", tmp_path / "run") == {
        "grounding_of": 1,
        "failures_of": 1,
        "grade_record": 1,
        "RunFolder.episodes": 1,
        "RunFolder.grades": 1,
    }
