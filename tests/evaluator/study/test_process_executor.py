"""Tests of episodes that several processes on this machine play."""

import errno
import os
import socket
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from evaluator.commands.program import main
from evaluator.errors import UsageError
from evaluator.records.episode import Outcome
from evaluator.records.run import Plan, ServerRecord
from evaluator.store.run_folder import RunFolder
from evaluator.study import process_executor
from evaluator.study.process_executor import process_workers, usual_workers
from evaluator.study.run_config import RunConfig, participants_of
from evaluator.study.run_start import run_record
from scenes import find_pack
from tests.builders.records import episode_key

AGENT = '''
import os
import signal
from pathlib import Path

from evaluator.episode.player import Reply
from evaluator.records.episode import ToolCall


class Fatal:
    """Kills the process that plays it once, in the episode of seed 2."""

    name = "fatal"

    def player(self, key, briefing):
        self.seed = key.seed
        return Once(key.seed)


class Once:
    def __init__(self, seed):
        self.seed = seed

    async def act(self, feedback):
        note = Path(__file__).with_name("killed")
        if self.seed == 2 and not note.exists():
            note.write_text(str(os.getpid()))
            os.kill(os.getpid(), signal.SIGKILL)
        return Reply(calls=(ToolCall(tool="answer", arguments={"answer": self.seed}),))

'''
WORDS = ("--server", "host", "--scenes", "7", "--seeds", "0-5", "--concurrency", "4", "--workers", "2")


@pytest.fixture
def agents(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "fatal_agents.py").write_text(AGENT, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    return tmp_path


def test_a_worker_that_is_killed_costs_nobody_an_episode(agents: Path) -> None:
    out = agents / "run"
    assert main(["--agent", "fatal_agents:Fatal", *WORDS, "--out", str(out)]) == 0
    killed = int((agents / "killed").read_text(encoding="utf-8"))
    assert killed != os.getpid()
    folder = RunFolder(out)
    lines = folder.episodes_file.read_text(encoding="utf-8").splitlines()
    played = {key.seed: episode for key, episode in folder.episodes().items()}
    assert len(lines) == len(played) == 6
    assert {seed: episode.answer for seed, episode in played.items()} == {seed: seed for seed in range(6)}
    assert {episode.outcome for episode in played.values()} == {Outcome.ANSWERED}
    assert played[2].attempts == 2


def leaves(error: BaseException) -> list[BaseException]:
    parts = error.exceptions if isinstance(error, BaseExceptionGroup) else ()
    return [leaf for part in parts for leaf in leaves(part)] or [error]


async def start(agent: str = "") -> None:
    """Start two workers, and let them play an episode of an unknown agent."""
    config, plan = RunConfig(agents=("random",), concurrency=2), Plan(scenes=(7,), agents=("random",))
    record = run_record(plan, [find_pack(7)], ServerRecord(option="stdio"))
    async with process_workers(config, participants_of(config), record, count=2) as play:
        assert agent, "no worker can start"
        await play(episode_key(agent=agent))


async def test_a_bug_is_shown_with_the_place_where_it_is() -> None:
    with pytest.raises(BaseExceptionGroup) as failed:
        await start("nobody")
    (bug,) = leaves(failed.value)
    assert isinstance(bug, RuntimeError)
    assert "workers.py" in str(bug)
    assert "KeyError: 'nobody'" in str(bug)


async def test_a_worker_that_cannot_start_is_reported_in_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "python"
    program.write_text("#!/bin/sh\necho first >&2\necho no such library >&2\nexit 3\n", encoding="utf-8")
    program.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(program))
    with pytest.raises(BaseExceptionGroup) as failed:
        await start()
    assert {str(error) for error in leaves(failed.value)} == {"a worker process cannot start: no such library"}


async def test_a_worker_for_which_there_is_no_file_left_is_reported_in_one_sentence(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def none_left() -> None:
        raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))

    monkeypatch.setattr(socket, "socketpair", none_left)
    with pytest.raises(BaseExceptionGroup) as failed:
        await start()
    problems = leaves(failed.value)
    assert {type(problem) for problem in problems} == {UsageError}
    assert {str(problem) for problem in problems} == {"a worker process cannot start: Too many open files"}


def test_by_default_there_are_as_many_workers_as_are_worth_their_start(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process_executor, "_processors", lambda: 8)
    monkeypatch.setattr(process_executor, "_free_memory", lambda: 2**40)
    host = RunConfig(agents=("random",), server="host")
    assert usual_workers(replace(host, concurrency=100), 1000) == 8
    assert usual_workers(replace(host, concurrency=12), 1000) == 3
    assert usual_workers(replace(host, concurrency=100), 60) == 2
    assert usual_workers(replace(host, concurrency=1), 1) == 1
    assert usual_workers(RunConfig(agents=("random",), server="stdio", concurrency=100), 1000) == 1
    assert usual_workers(RunConfig(agents=("external",), server="host", concurrency=100), 1000) == 1
    monkeypatch.setattr(process_executor, "_free_memory", lambda: 2**30)
    assert usual_workers(replace(host, concurrency=100), 1000) == 2
    monkeypatch.setattr(process_executor, "_free_memory", lambda: 0)
    assert usual_workers(replace(host, concurrency=100), 1000) == 1


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--executor", "ray"), "--workers: Ray has a worker for each processor"),
        (("--agent", "external"), "--workers: external agents are processes of their own"),
    ],
)
def test_workers_are_refused_where_they_cannot_play(
    words: tuple[str, ...], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--workers", "2", "--out", str(tmp_path / "run"), *words]) == 2
    assert said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
