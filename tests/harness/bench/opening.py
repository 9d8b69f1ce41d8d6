"""Processor time to open an episode, in process and in a warm host, and the memory of many open episodes.

python -m tests.harness.bench.opening [EPISODES] prints the rows, then the memory of EPISODES on one host (1000).
"""

import json
import subprocess
import sys
import time
from collections.abc import AsyncGenerator, Generator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import anyio
import httpx
from mcp import Client

from physment_mcp import open_episode
from physment_mcp.scene import load_scene, scene_ids
from physment_mcp.session import Session
from physment_mcp.world.loading import load
from tests.harness.bench.measuring import Row, Work, busy_against_aim, compare_busy

SCENES = (7, 25, 100, 203)
"""Scenes of small and large size, without and with laws."""
_OPENED = 200


async def rows() -> AsyncGenerator[Row]:
    """Lines for the table."""
    for scene in SCENES:
        yield busy_against_aim(f"open scene {scene} in process, kept", partial(open_episode, scene, 1), 1e-3, calls=20)
    for scene in SCENES:
        mjcf = load_scene(scene, 1).mjcf
        opened: Work = partial(Session, load_scene(scene, 1))
        yield compare_busy(
            f"a session of scene {scene}, against compiling it", opened, partial(load, mjcf), 0.5, calls=5
        )
    with _host() as (process, url), httpx.Client(base_url=url) as http:
        for scene in SCENES:
            asking = partial(http.post, "/episodes")
            opening = _in_host(process, partial(asking, json={"scene": scene, "seed": 1}))
            refusing = _in_host(process, partial(asking, json={"scene": 7, "seed": "x"}))
            taken = max(opening - refusing, 1e-6)
            what = f"open scene {scene} in the warm host, processor, without HTTP ({1000 * refusing:.2f} ms)"
            yield Row(what, taken, 2e-3, taken / 2e-3, 1.0)


@contextmanager
def _host() -> Generator[tuple["subprocess.Popen[str]", str]]:
    command = [sys.executable, "-m", "physment_mcp", "serve", "--port", "0", "--max-episodes", "8000"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process, json.loads(process.stdout.readline())["listening"]
        finally:
            process.terminate()


def _in_host(process: "subprocess.Popen[str]", request: Work) -> float:
    """Processor time of the host for one request [s]."""
    request()
    before = _processor_s(process.pid)
    for _ in range(_OPENED):
        request()
    return (_processor_s(process.pid) - before) / _OPENED


def _processor_s(pid: int) -> float:
    """Processor time that a process has used [s]. Source: Linux, /proc/PID/schedstat of all its threads."""
    tasks = Path(f"/proc/{pid}/task").iterdir()
    return sum(int((task / "schedstat").read_text().split()[0]) for task in tasks) / 1e9


def _resident(pid: int) -> float:
    """Memory that a process occupies [kB]."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * 4.096


async def memory(episodes: int) -> None:
    """Open episodes of all scenes on one host, make a few calls on each, and print the memory that they use."""
    ids = scene_ids()
    with _host() as (process, url):
        async with httpx.AsyncClient(base_url=url, timeout=60) as http:

            async def play(number: int) -> None:
                body = {"scene": ids[number % len(ids)], "seed": number // len(ids) // 4}
                async with Client((await http.post("/episodes", json=body)).json()["mcp_url"]) as client:
                    await client.call_tool("step", {"duration": 0.1})
                    await client.call_tool("get_center_of_mass", {})
                    await client.call_tool("get_position", {"object_id": "object_1"})

            for number in range(len(ids)):  # compiles one model of each scene
                await play(number)
            before, start = _resident(process.pid), time.monotonic()
            for number in range(len(ids), len(ids) + episodes):
                await play(number)
            each = (_resident(process.pid) - before) / episodes
            print(f"{episodes} more episodes in {time.monotonic() - start:.0f} s: {each:.0f} kB each", end=", ")
            print(f"the host occupies {_resident(process.pid) / 1000:.0f} MB")


async def main() -> None:
    """Print the rows and the memory."""
    async for row in rows():
        print(f"{row.what:80} {1e6 * row.ours_s:9.0f} µs {1e6 * row.theirs_s:9.0f} µs {row.ratio:7.3f} ≤ {row.aim:g}")
    await memory(int(sys.argv[1]) if len(sys.argv) > 1 else 1000)


if __name__ == "__main__":
    anyio.run(main)
