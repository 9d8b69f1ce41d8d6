"""Tests of episodes on Ray workers, on a cluster of several nodes on this machine. Some nodes are killed during a run.

Skipped if Ray, a large package, is not installed.
"""

import importlib
import importlib.util
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import pytest

from evaluator.commands.program import main

HAS_RAY = importlib.util.find_spec("ray") is not None
needs_ray = pytest.mark.skipif(
    not HAS_RAY, reason="Ray is not installed; `python -m tests.harness.frameworks ray` installs it"
)
STORE_BYTES = 80 * 2**20
"""Size of the object store of a node: about the least that Ray accepts."""
WORDS = ("--agent", "random", "--scenes", "7,21", "--seeds", "0-9", "--executor", "ray", "--concurrency", "4")


@pytest.fixture
def cluster() -> Iterator[Any]:
    """A cluster whose head node runs no workers. The tests add nodes."""
    head = {"num_cpus": 0, "object_store_memory": STORE_BYTES, "include_dashboard": False}
    made = importlib.import_module("ray.cluster_utils").Cluster(initialize_head=True, head_node_args=head)
    try:
        yield made
    finally:
        made.shutdown()


def add_node(cluster: Any) -> Any:
    return cluster.add_node(num_cpus=1, object_store_memory=STORE_BYTES)


@contextmanager
def started(cluster: Any, folder: Path, *words: str, **environ: str) -> Generator[subprocess.Popen[str]]:
    """Start the command on that cluster, and end it in every case."""
    command = [sys.executable, "-m", "evaluator", *WORDS, "--out", "run", *words]
    environ = os.environ | {"RAY_ADDRESS": cluster.address} | environ
    with subprocess.Popen(
        command, cwd=folder, env=environ, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    ) as process:
        watchdog = threading.Timer(120, process.kill)
        watchdog.start()
        try:
            yield process
        finally:
            watchdog.cancel()
            process.kill()


def read_until(stream: IO[str] | None, count: int) -> None:
    """Read the output of the command until this many episodes have ended."""
    assert stream is not None
    assert any(line.startswith(f"[{count}/") for line in stream), "the command ended before"


def episodes(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "run" / "episodes.jsonl").read_text(encoding="utf-8").splitlines()]


@needs_ray
def test_if_nodes_die_no_episode_is_lost_or_recorded_twice(cluster: Any, tmp_path: Path) -> None:
    first, second = add_node(cluster), add_node(cluster)
    with started(cluster, tmp_path) as process:
        read_until(process.stdout, 3)
        cluster.remove_node(first, allow_graceful=False)
        read_until(process.stdout, 6)
        # The last node with workers: from here on, only workers that Ray starts again can play.
        add_node(cluster)
        cluster.remove_node(second, allow_graceful=False)
        said, _ = process.communicate()
        assert process.returncode == 0, said
    played = episodes(tmp_path)
    keys = [(episode["key"]["scene"], episode["key"]["seed"]) for episode in played]
    assert sorted(keys) == sorted((scene, seed) for scene in (7, 21) for seed in range(10))
    assert {episode["outcome"] for episode in played} <= {"answered", "budget_exhausted"}
    assert max(episode["attempts"] for episode in played) > 1, "no node that was killed had an episode under way"


@needs_ray
def test_an_interrupted_run_on_ray_can_be_continued_without_it(cluster: Any, tmp_path: Path) -> None:
    add_node(cluster)
    with started(cluster, tmp_path) as process:
        read_until(process.stdout, 2)
        process.send_signal(signal.SIGINT)
        said, _ = process.communicate()
        assert process.returncode == 130, said
    assert "--out run --resume" in said
    kept = len(episodes(tmp_path))
    assert 2 <= kept < 20
    words = [*WORDS, "--executor", "local", "--server", "host", "--out", str(tmp_path / "run"), "--resume"]
    assert main(words) == 0
    keys = [(episode["key"]["scene"], episode["key"]["seed"]) for episode in episodes(tmp_path)]
    assert len(keys) == len(set(keys)) == 20


@needs_ray
def test_what_a_node_lacks_is_reported_in_one_sentence(cluster: Any, tmp_path: Path) -> None:
    add_node(cluster)
    # The key is in the environment of the run, and not in that of the nodes.
    with started(cluster, tmp_path, "--agent", "model:gpt-5.5", OPENAI_API_KEY="sk-loopback") as process:
        said, _ = process.communicate()
    assert process.returncode == 2, said
    assert "cannot play: model:gpt-5.5: OPENAI_API_KEY is not set" in said
    assert "Traceback" not in said
    assert "sk-loopback" not in said
    assert list(tmp_path.iterdir()) == []


NOBODY = """
import anyio
from evaluator.study.run_config import participants_of
from evaluator.study.run_config import RunConfig
from evaluator.study.run_start import run_record
from evaluator.study.ray_executor import ray_workers
from evaluator.records.run import Plan, ServerRecord
from scenes import find_pack

async def run():
    config, plan = RunConfig(agents=("random",), concurrency=2), Plan(scenes=(7,), agents=("random",))
    record = run_record(plan, [find_pack(7)], ServerRecord(option="stdio"))
    async with ray_workers(config, participants_of(config), record, patience_s=3) as play:
        await play(plan.matrix()[0])

anyio.run(run)
"""


@needs_ray
def test_a_cluster_without_room_is_not_waited_for_forever(cluster: Any) -> None:
    environ = os.environ | {"RAY_ADDRESS": cluster.address}
    command = [sys.executable, "-c", NOBODY]
    done = subprocess.run(command, env=environ, capture_output=True, text=True, check=False, timeout=300)
    assert "PermanentFailure: no Ray worker was there for 3 s" in done.stderr


@needs_ray
@pytest.mark.parametrize(
    ("address", "problem"),
    [
        ("127.0.0.1:9", "Connection refused"),
        ("nonsense", "nonsense"),
        ("ray://127.0.0.1:10001", "start the run on a machine of the cluster"),
    ],
)
def test_an_address_without_a_cluster_gives_one_sentence(address: str, problem: str, tmp_path: Path) -> None:
    command = [sys.executable, "-m", "evaluator", *WORDS, "--server", "host", "--out", "run"]
    environ = os.environ | {"RAY_ADDRESS": address}
    done = subprocess.run(command, cwd=tmp_path, env=environ, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 2
    (line,) = done.stderr.strip().splitlines()
    assert line.startswith(f"physment-eval: --executor ray: no cluster at RAY_ADDRESS={address}")
    assert problem in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(HAS_RAY, reason="Ray is installed")
def test_without_ray_one_sentence_says_how_to_get_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--executor", "ray", "--scenes", "7", "--out", str(tmp_path / "run")]) == 2
    assert "pip install 'physment-mcp[ray]'" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
