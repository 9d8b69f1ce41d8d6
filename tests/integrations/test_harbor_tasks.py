"""Tests of Harbor task folders: their scripts run as in containers; the agent has access to its episode only."""

import contextlib
import json
import os
import shutil
import socket
import subprocess
import sys
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path

import httpx
import pytest

from evaluator.answers.keys import KeyRing
from tests.builders.commands import physment_eval
from tests.builders.paths import ROOT

SEED = 41_287
PATH = os.pathsep.join([str(Path(sys.executable).parent), "/usr/bin", "/bin"])
ENVIRONMENT = {"PATH": PATH, "PYTHONPATH": str(ROOT)}
"""Environment variables of a container, with this checkout in place of the installed packages."""


@dataclass(frozen=True)
class Containers:
    """The files of a task, arranged as in its containers."""

    task: Path
    root: Path
    port: int

    def run(self, script: Path, **variables: str) -> subprocess.CompletedProcess[str]:
        """Run a script to its end."""
        url = f"http://127.0.0.1:{self.port}/episodes/0/mcp"
        own = ENVIRONMENT | {"PHYSMENT_PORT": str(self.port), "PHYSMENT_MCP_URL": url}
        command = [sys.executable if script.suffix == ".py" else "/bin/sh", str(script)]
        command += [str(self.root / "calls.json")] if script.name == "collect.py" else []
        return subprocess.run(
            command, env=own | variables, cwd=self.root, capture_output=True, text=True, check=False, timeout=120
        )

    def verified(self) -> dict[str, float]:
        """The rewards that the verifier writes."""
        collected = self.run(self.root / "laboratory" / "collect.py")
        assert collected.returncode == 0, collected.stderr
        shutil.copytree(self.task / "tests", self.root / "tests", dirs_exist_ok=True)
        where = {"EVIDENCE": str(self.root / "calls.json"), "VERIFIER_LOGS": str(self.root)}
        done = self.run(self.root / "tests" / "test.sh", **where)
        assert done.returncode == 0, done.stderr
        return json.loads((self.root / "reward.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def task(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("harbor") / "tasks"
    done = physment_eval("harbor", "write", str(folder), "--scenes", "23", "--seeds", str(SEED))
    assert (done.returncode, done.stdout) == (0, f"1 tasks are written in {folder}\n"), done.stderr
    return folder / "scene23-1"


@contextlib.contextmanager
def started(task: Path, root: Path) -> Generator[Containers]:
    """Start the laboratory of a task as its container does."""
    shutil.copytree(task / "environment" / "laboratory", root / "laboratory")
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    command = ["/bin/sh", str(root / "laboratory" / "start.sh")]
    own = ENVIRONMENT | {"PHYSMENT_PORT": str(port)}
    with subprocess.Popen(command, env=own, cwd=root, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            assert "listening" in process.stdout.readline()
            yield Containers(task, root, port)
        finally:
            process.terminate()


def test_the_solution_of_a_task_scores_1(task: Path, tmp_path: Path) -> None:
    with started(task, tmp_path) as containers:
        solved = containers.run(task / "solution" / "solve.sh")
        assert solved.returncode == 0, solved.stderr
        found = containers.verified()
    calls = json.loads((task / "solution" / "calls.json").read_text(encoding="utf-8"))
    assert found == {"reward": 1, "strict": 1, "normalised": 1, "graded": 1, "answered": 1, "calls": len(calls)}


def test_an_agent_can_open_read_and_close_nothing_and_scores_0_without_a_right_answer(
    task: Path, tmp_path: Path
) -> None:
    def graded() -> dict[str, float]:
        assert containers.run(tmp_path / "laboratory" / "collect.py").returncode == 0
        episode = task / "tests" / "episode.json"
        return json.loads(physment_eval("harbor", "grade", tmp_path / "calls.json", "--episode", episode).stdout)

    with started(task, tmp_path) as containers, httpx.Client(base_url=f"http://127.0.0.1:{containers.port}") as agent:
        for method, path in (("POST", "/episodes"), ("GET", "/episodes/0/calls"), ("DELETE", "/episodes/0")):
            for headers in ({}, {"Authorization": "Bearer x"}):
                assert agent.request(method, path, headers=headers).status_code == 401
        assert agent.get("/healthz").json() == {"status": "ok", "episodes": 1}
        untouched = graded()
        shutil.copytree(task / "solution", tmp_path / "solution")
        wrong_calls = '[{"tool": "answer", "arguments": {"answer": -1}}]'
        (tmp_path / "solution" / "calls.json").write_text(wrong_calls, encoding="utf-8")
        assert containers.run(tmp_path / "solution" / "solve.sh").returncode == 0
        wrong = graded()
    assert (untouched["reward"], untouched["answered"], untouched["calls"]) == (0, 0, 0)
    assert (wrong["reward"], wrong["answered"], wrong["calls"]) == (0, 1, 1)


def test_the_agent_is_told_no_answer_and_no_seed_and_the_laboratory_holds_no_pack(task: Path) -> None:
    key = KeyRing().key(23, SEED).value
    assert isinstance(key, float)
    told = [task / "instruction.md", task / "task.toml", task / "environment" / "Dockerfile"]
    text = task.name + "".join(path.read_text(encoding="utf-8") for path in told)
    assert str(SEED) not in text
    assert f"{key:.3g}" not in text
    # Nothing of the folder gets into the agent's container.
    assert "COPY" not in (task / "environment" / "Dockerfile").read_text(encoding="utf-8")
    packs = task / "environment" / "laboratory" / "scenes" / "Scene23"
    assert {path.name for path in packs.iterdir()} == {"scene23.public.json", f"scene23.seed{SEED}.xml"}


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["write", "{folder}"], "is not an empty folder"),
        (["write", "{folder}/new", "--split", "tests"], "there is no split 'tests'"),
        (["grade", "{folder}/none", "--episode", "{folder}/episode.json"], "is no log of calls"),
        (["grade", "{folder}/none", "--episode", "{folder}/none"], "is no episode.json of a task"),
    ],
)
def test_what_cannot_be_written_or_graded_is_said_in_one_sentence(tmp_path: Path, words: list[str], says: str) -> None:
    (tmp_path / "episode.json").write_text('{"scene": 7, "seed": 0, "max_calls": 9}', encoding="utf-8")
    done = physment_eval("harbor", *(word.format(folder=tmp_path) for word in words))
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)
    assert says in done.stderr
