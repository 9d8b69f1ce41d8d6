"""The warm host that the evaluator starts: nothing is left of it, however the evaluator ends."""

import signal
import subprocess
import sys
import time

import httpx

HOLD = """
import anyio
from evaluator.connect import LocalHost

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


def test_a_host_ends_with_an_evaluator_that_is_killed() -> None:
    with subprocess.Popen([sys.executable, "-c", HOLD], stdout=subprocess.PIPE, text=True) as held:
        assert held.stdout is not None
        url = held.stdout.readline().strip()
        assert answers(url)
        held.send_signal(signal.SIGKILL)
        assert held.wait() == -signal.SIGKILL
        deadline = time.monotonic() + 60
        while answers(url):
            assert time.monotonic() < deadline, "the host outlives the evaluator"
