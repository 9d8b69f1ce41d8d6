"""Tests of the host that the evaluator starts: its capacity, and that it always ends with the evaluator."""

import json
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import httpx

HOLD = """
import anyio
from evaluator.episode.hosts import LocalHost

async def hold():
    async with LocalHost() as laboratory:
        print(laboratory.base_url, flush=True)
        await anyio.sleep_forever()

anyio.run(hold)
"""


def answers(url: str) -> bool:
    try:
        return httpx.get(f"{url}/healthz").is_success
    except httpx.TransportError:
        return False


def test_the_local_host_ends_when_the_evaluator_is_killed() -> None:
    with subprocess.Popen([sys.executable, "-c", HOLD], stdout=subprocess.PIPE, text=True) as held:
        assert held.stdout is not None
        url = held.stdout.readline().strip()
        assert answers(url)
        held.send_signal(signal.SIGKILL)
        assert held.wait() == -signal.SIGKILL
        deadline = time.monotonic() + 120
        while answers(url):
            assert time.monotonic() < deadline, "the host outlives the evaluator"


def test_more_episodes_can_be_open_than_the_initial_limit_of_open_files(tmp_path: Path) -> None:
    few = 64  # what Python and its libraries need to start, and little more
    _, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    command = [sys.executable, "-m", "evaluator", "--server", "host", "--agent", "blind", "--scenes", "7", "--json"]
    command += ["--seeds", "0-59", "--concurrency", "60", "--out", str(tmp_path / "run")]
    ended = subprocess.run(
        command,
        capture_output=True,
        text=True,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (few, hard)),
    )
    assert ended.returncode == 0, ended.stderr[-1000:]
    assert json.loads(ended.stdout)["overall"]["outcomes"] == {"answered": 60}
