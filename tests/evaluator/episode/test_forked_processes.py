"""Tests of episodes on stdio whose processes are forked from one process."""

import os
import signal
from pathlib import Path

import anyio
import pytest

from evaluator.episode.connect import EpisodeConnector, connect
from evaluator.episode.connections import AVAILABLE
from evaluator.errors import InfrastructureError

pytestmark = [
    pytest.mark.anyio,
    pytest.mark.skipif(not AVAILABLE, reason="sockets cannot be passed here"),
    pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="processes are found in /proc"),
]


def children_of(parent: int) -> list[int]:
    found: list[int] = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            fields = (process / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue  # it has just ended
        if int(fields[1]) == parent and fields[0] != "Z":
            found.append(int(process.name))
    return found


def forking() -> list[int]:
    """Return the fork servers that this test run has started."""
    found = children_of(os.getpid())
    return [process for process in found if b"fork-server" in Path(f"/proc/{process}/cmdline").read_bytes()]


async def all_ended(parent: int) -> None:
    with anyio.fail_after(30):
        while children_of(parent):  # noqa: ASYNC110 - no event reports it
            await anyio.sleep(0.02)


async def killed_while_playing(laboratory: EpisodeConnector) -> None:
    async with laboratory.open(7, 0) as client:
        (parent,) = forking()
        os.kill(max(children_of(parent)), signal.SIGKILL)
        await client.call_tool("step", {"duration": 0.5})


async def time_after(laboratory: EpisodeConnector, duration: float) -> object:
    async with laboratory.open(7, 0) as client:
        result = await client.call_tool("step", {"duration": duration})
        return (result.structured_content or {})["sim_time"]


async def test_each_episode_has_a_process_of_its_own_and_none_is_left() -> None:
    async with connect("stdio", None) as laboratory:
        async with laboratory.open(7, 0) as one, laboratory.open(7, 0) as other:
            await one.call_tool("step", {"duration": 1.0})
            still = await other.call_tool("get_velocity", {"object_id": "object_1"})
            assert (still.structured_content or {})["sim_time"] == 0
            (parent,) = forking()
            assert len(children_of(parent)) == 2
        await all_ended(parent)
    assert not forking()


async def test_if_the_process_that_forks_is_killed_another_is_started_and_open_episodes_go_on() -> None:
    async with connect("stdio", None) as laboratory, laboratory.open(7, 0) as client:
        (parent,) = forking()
        os.kill(parent, signal.SIGKILL)
        assert not (await client.call_tool("step", {"duration": 0.5})).is_error
        assert await time_after(laboratory, 0.25) == 0.25


async def test_a_fork_that_is_killed_fails_its_own_episode() -> None:
    async with connect("stdio", None) as laboratory, laboratory.open(8, 0) as other:
        with pytest.raises(InfrastructureError, match="the server process of scene 7 failed"):
            await killed_while_playing(laboratory)
        assert not (await other.call_tool("step", {"duration": 0.5})).is_error


async def test_why_a_fork_ended_is_said_in_its_own_words() -> None:
    async with connect("stdio", None) as laboratory:
        with pytest.raises(InfrastructureError, match=r"scene 9999 failed: physment-mcp: .*9999"):
            async with laboratory.open(9999, 0):
                pass
        assert await time_after(laboratory, 0.25) == 0.25


async def test_a_folder_of_scenes_reaches_the_forks(tmp_path: Path) -> None:
    async with connect("stdio", tmp_path) as laboratory:
        with pytest.raises(InfrastructureError, match="scene 7 failed"):
            async with laboratory.open(7, 0):
                pass


async def test_if_the_process_that_forks_cannot_load_its_last_words_are_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mujoco.py").write_text('raise ImportError("no engine here")', encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    async with connect("stdio", None) as laboratory:
        with pytest.raises(InfrastructureError, match="scene 7 failed: ImportError: no engine here"):
            async with laboratory.open(7, 0):
                pass
