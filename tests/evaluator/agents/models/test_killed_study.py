"""Tests that a study of a model, killed twice during its requests, ends with the results of an undisturbed study."""

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any

from evaluator.records.run import Plan
from evaluator.store.run_folder import RunFolder
from tests.builders.providers import Say, Service

SCENES, BUDGETS = (7, 12, 21, 45, 60, 99), (2, 5)
EPISODES = len(SCENES) * len(BUDGETS)
WORDS = ("--scenes", ",".join(map(str, SCENES)), "--budgets", "2,5", "--concurrency", "3", "--json")


class Physicist:
    """A stateless model that steps, reads, and answers with the speed it read. Sets an event at a chosen request."""

    def __init__(self) -> None:
        self._asked = 0
        self._call_at = 0
        self.called = threading.Event()

    def call_out(self, after: int) -> None:
        """Set the event `called` after this many more requests."""
        self.called.clear()
        self._call_at = self._asked + after

    def __call__(self, seen: Any) -> Any:
        self._asked += 1
        if self._asked == self._call_at:
            self.called.set()
        velocities = [json.loads(returned)["velocity"] for returned in seen.returns if '"velocity"' in returned]
        if velocities:
            return Say("That is its speed.", [("answer", {"answer": abs(velocities[0][2])})])
        if seen.returns:
            return Say("I look.", [("get_velocity", {"object_id": "object_1"})])
        look = [("get_velocity", {"object_id": "object_1"})] if "2 iterations" in seen.last else []
        return Say("I wait.", [("step", {"duration": 0.8}), *look])


def start(service: Service, server: str, folder: Path, *words: str) -> subprocess.Popen[str]:
    agent = f"model:{service.dialect.name}:{service.dialect.model}"
    command = [sys.executable, "-m", "evaluator", "--agent", agent, "--server", server, *WORDS, *words]
    pipe = subprocess.PIPE
    return subprocess.Popen(
        command,
        cwd=folder,
        env=os.environ | service.environ,
        stdout=pipe,
        stderr=pipe,
        text=True,
        start_new_session=True,
    )


def finish(process: subprocess.Popen[str]) -> Any:
    """Wait for the end of a run, and return its summary."""
    with process:
        out, said = process.communicate(timeout=300)
    assert process.returncode == 0, said
    return json.loads(out)


def verdicts(folder: RunFolder) -> dict[Any, tuple[Any, ...]]:
    return {key: (record.grade, record.answer_key) for key, record in folder.grades().items()}


def recorded(folder: Path) -> list[Any]:
    """The keys of the complete lines on disk."""
    file = folder / "episodes.jsonl"
    lines: Sequence[bytes] = file.read_bytes().split(b"\n")[:-1] if file.exists() else []
    return [json.dumps(json.loads(line)["key"]) for line in lines]


def test_a_study_killed_while_a_model_is_asked_is_completed_with_the_same_results(
    openai: Service, tmp_path: Path, host_url: str
) -> None:
    service, model, random, kept = openai, Physicist(), Random(4), 0
    service.latency_s = 0.02
    for _ in range(500):
        service.compute(model)
    for _ in range(2):
        model.call_out(after=random.randint(1, 12))
        with start(service, host_url, tmp_path, "--out", "run", "--resume") as process:
            # Kill during a request, so that an episode is in progress.
            called = model.called.wait(timeout=300)
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate(timeout=300)
        assert called
        assert process.returncode == -signal.SIGKILL
        assert kept <= len(recorded(tmp_path / "run")) < EPISODES
        kept = len(recorded(tmp_path / "run"))
    resumed = finish(start(service, host_url, tmp_path, "--out", "run", "--resume"))
    keys = recorded(tmp_path / "run")
    agent = f"model:{service.dialect.name}:{service.dialect.model}"
    matrix = Plan(scenes=SCENES, agents=(agent,), budgets=BUDGETS).matrix()
    assert sorted(keys) == sorted(json.dumps(json.loads(key.model_dump_json())) for key in matrix)
    whole = finish(start(service, host_url, tmp_path, "--out", "whole"))
    assert resumed == whole
    assert 0 < whole["overall"]["n_correct"] < EPISODES
    assert verdicts(RunFolder(tmp_path / "run")) == verdicts(RunFolder(tmp_path / "whole"))
