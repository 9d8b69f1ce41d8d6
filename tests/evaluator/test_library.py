"""Tests of the public interface for Python programs: its names, and that its functions do what the commands do."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import evaluator
from evaluator import UsageError, connect, episode_of_log, grade, load_run, play, score, select, summary
from evaluator.agents.baselines import BlindAgent
from evaluator.agents.reference import ReferenceAgent
from evaluator.commands.program import main
from evaluator.records.episode import Outcome, Verdict


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


async def test_episodes_share_a_laboratory_and_their_prompts_have_examples_if_asked_for(host_url: str) -> None:
    async with connect(host_url) as laboratory:
        played = [
            await play(ReferenceAgent(), 7, seed=1, prompting=prompting, server=laboratory)
            for prompting in ("zero-shot", "few-shot-cot")
        ]
    assert [episode.key.prompting for episode in played] == ["zero-shot", "few-shot-cot"]
    assert len(played[0].prompt) < len(played[1].prompt)
    assert {grade(episode).grade.strict for episode in played} == {Verdict.CORRECT}


def logged(tool: str, start: float, **arguments: Any) -> dict[str, Any]:
    """Return a call as the log of a host contains it."""
    return {"tool": tool, "arguments": arguments, "returned": True, "is_error": False, "content": {}, "text": "{}"} | {
        "started_s": start,
        "duration_s": 0.5,
    }


def test_a_log_of_calls_is_an_episode_that_can_be_graded() -> None:
    calls = [logged("step", 1.0, duration=0.8), logged("answer", 2.0, answer=7.848)]
    log = json.dumps({"ended": True, "calls": calls}).encode()
    episode = episode_of_log(log, 7, max_calls=9)
    assert (episode.outcome, episode.answer, len(episode.turns), episode.max_calls) == (Outcome.ANSWERED, 7.848, 2, 9)
    assert episode.duration_s == pytest.approx(2.5)
    assert grade(episode).grade.strict is Verdict.CORRECT
    unanswered = json.dumps({"ended": False, "calls": calls[:1]}).encode()
    assert episode_of_log(unanswered, 7, max_calls=9).outcome is Outcome.BUDGET_EXHAUSTED
    with pytest.raises(UsageError, match="this is no log of calls"):
        episode_of_log(b"{}", 7, max_calls=9)
    with pytest.raises(UsageError, match="no scene 6"):
        episode_of_log(log, 6, max_calls=9)


def test_a_selection_has_scenes_and_seeds_by_the_words_of_the_command_line() -> None:
    assert select().seeds == (0,)
    chosen = select(scenes="7-9", seeds="1,3-4")
    assert ([files.scene_id for files in chosen.packs], chosen.seeds, chosen.split) == ([7, 8, 9], (1, 3, 4), "")
    assert select("test-ideas", scenes="8").split == "test-ideas@1"


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
