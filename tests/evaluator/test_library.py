"""The public interface for Python programs: the names it has, and that they do what the commands do."""

import subprocess
import sys
from pathlib import Path

import pytest

import evaluator
from evaluator import UsageError, grade, load_run, play, score, summary
from evaluator.agents.baselines import BlindAgent
from evaluator.agents.reference import ReferenceAgent
from evaluator.commands.program import main
from evaluator.records import Verdict


def test_the_public_names_are_sorted_exist_and_are_documented() -> None:
    assert evaluator.__all__ == sorted(evaluator.__all__)
    assert all(getattr(evaluator, name).__doc__ for name in evaluator.__all__)
    assert set(evaluator.__all__) <= set(dir(evaluator))


def test_the_lazy_names_are_those_of_all() -> None:
    assert sorted(name for names in evaluator._HOMES.values() for name in names) == evaluator.__all__


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = evaluator.nothing  # type: ignore[attr-defined]  # pyright: ignore[reportAttributeAccessIssue]


def test_importing_the_package_loads_neither_mcp_nor_the_engine() -> None:
    code = "import sys, evaluator; sys.exit(any(name in sys.modules for name in ('mcp', 'mujoco', 'scipy')))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


async def test_an_episode_is_played_graded_and_scored_without_files() -> None:
    episode = await play(ReferenceAgent(), 7, seed=3, budget=5)
    assert grade(episode).grade.strict is Verdict.CORRECT
    (row,) = score([episode])
    assert row.category == "easy-single"
    assert summary([row]).overall.n_correct == 1


async def test_a_scene_that_does_not_exist_is_refused() -> None:
    with pytest.raises(UsageError, match="no scene 6"):
        await play(BlindAgent(), 6)


def test_a_run_folder_is_loaded_with_its_grades(tmp_path: Path, host_url: str) -> None:
    words = ["--scenes", "7,8", "--server", host_url, "--agent", "blind", "--concurrency", "1"]
    assert main([*words, "--out", str(tmp_path / "run")]) == 0
    run = load_run(tmp_path / "run")
    assert [episode.key.scene for episode in run.episodes] == [7, 8]
    assert list(run.grades) == [episode.key for episode in run.episodes]
    assert score(run.episodes)[0].grade == run.grades[run.episodes[0].key].grade
