"""Tests of episodes that the evaluator opens over sockets on a host that it started."""

import errno
import os
import socket
from dataclasses import replace
from pathlib import Path

import anyio
import pytest

from evaluator.episode.connections import ControlSocket, passed
from evaluator.episode.hosts import HostConnector, LocalHost
from evaluator.errors import InfrastructureError, UsageError


async def kill_during_an_episode(local: LocalHost, laboratory: HostConnector) -> None:
    async with laboratory.open(7, 0) as client:
        assert local._process is not None
        local._process.kill()
        await client.call_tool("step", {"duration": 0.1})


NOWHERE = "http://127.0.0.1:9"


async def test_episodes_need_no_http_and_leave_room_when_they_are_closed_and_end_with_the_host() -> None:
    local = LocalHost(max_episodes=1, token="ours")
    with anyio.fail_after(120):
        async with local as host:
            laboratory = replace(host, base_url=NOWHERE)
            for seed in range(3):
                async with laboratory.open(7, seed) as client:
                    assert (await client.call_tool("step", {"duration": 0.1})).structured_content is not None
                    with pytest.raises(InfrastructureError, match="opened no episode: 1 episodes are open"):
                        async with laboratory.open(7, 0):
                            pytest.fail("there is no room")
            with pytest.raises(InfrastructureError, match=r"opened no episode: .*999"):
                async with laboratory.open(999, 0):
                    pytest.fail("there is no such scene")
            with pytest.raises(InfrastructureError, match=r"failed: .*Connection closed"):
                await kill_during_an_episode(local, laboratory)
            with pytest.raises(InfrastructureError, match="the local host cannot be reached") as failed:
                async with laboratory.open(7, 0):
                    pytest.fail("the host is gone")
            assert len(str(failed.value).splitlines()) == 1


async def test_many_episodes_that_are_opened_at_once_all_get_their_socket() -> None:
    async with LocalHost() as host:
        times: list[float] = []

        async def play(seed: int) -> None:
            async with host.open(7, seed) as client:
                stepped = await client.call_tool("step", {"duration": 0.1})
                times.append((stepped.structured_content or {})["sim_time"])

        async with anyio.create_task_group() as tasks:
            for seed in range(40):
                tasks.start_soon(play, seed)
        assert times == [0.1] * 40


async def test_openings_wait_for_a_process_that_takes_sockets_slowly() -> None:
    ours, theirs = socket.socketpair()
    ours.setblocking(False)
    theirs.setblocking(False)
    ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1)  # as little as the system allows
    control, count, closed = ControlSocket(ours), 30, 0

    async def open_one() -> None:
        nonlocal closed
        async with passed(control):
            pass
        closed += 1

    with ours, theirs, anyio.fail_after(60):
        async with anyio.create_task_group() as tasks:
            for _ in range(count):
                tasks.start_soon(open_one)
            await anyio.wait_all_tasks_blocked()
            assert closed == 0
            for _ in range(count):
                await anyio.wait_readable(theirs)
                _, brought, _, _ = socket.recv_fds(theirs, 1, 1)
                os.close(brought[0])
    assert closed == count


async def test_too_many_open_files_are_an_infrastructure_error(monkeypatch: pytest.MonkeyPatch) -> None:
    def none_left() -> None:
        raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))

    ours, theirs = socket.socketpair()
    with ours, theirs:
        monkeypatch.setattr(socket, "socketpair", none_left)
        with pytest.raises(InfrastructureError, match="cannot be reached: Too many open files"):
            async with HostConnector(NOWHERE, control=ControlSocket(ours)).open(7, 0):
                pytest.fail("there was no file")


async def test_a_host_that_does_not_start_says_why_in_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"^the local host did not start: physment-mcp: .*none") as failed:
        async with LocalHost(tmp_path / "none"):
            pytest.fail("it has no packs")
    assert len(str(failed.value).splitlines()) == 1


async def test_a_host_for_which_there_is_no_file_left_does_not_start(monkeypatch: pytest.MonkeyPatch) -> None:
    def none_left() -> None:
        raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))

    monkeypatch.setattr(socket, "socketpair", none_left)
    with pytest.raises(UsageError, match="did not start: Too many open files"):
        async with LocalHost():
            pytest.fail("there was no file")
