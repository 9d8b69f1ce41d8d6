"""A host of several processes: one port, and what holds for one process holds for all of them."""

import contextlib
import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import anyio
import httpx
import httpx2
import pytest
from mcp import Client
from mcp.client.streamable_http import streamable_http_client

from physment_mcp.serving.places import Places
from tests.builders.laboratory import Command

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="processes are found in /proc")

MOST = 4
TOKEN = {"Authorization": "Bearer ours"}
HELLO = {
    "jsonrpc": "2.0",
    "id": 1,
    "method": "initialize",
    "params": {"protocolVersion": "2025-06-18", "capabilities": {}, "clientInfo": {"name": "test", "version": "1"}},
}
ACCEPT = {"Accept": "application/json, text/event-stream"}


@dataclass(frozen=True)
class Served:
    url: str
    process: subprocess.Popen[str]

    def workers(self) -> list[int]:
        """Numbers of the worker processes, in the order in which they were started."""
        pid = self.process.pid
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text(encoding="ascii").split()
        return sorted(int(child) for child in children)

    def open(self, **wanted: Any) -> dict[str, str]:
        """An episode, opened on a connection of its own."""
        reply = httpx.post(f"{self.url}/episodes", json={"scene": 7, **wanted}, headers=TOKEN)
        assert reply.status_code == 201, reply.text
        return reply.json()

    def open_on_both(self, **wanted: Any) -> tuple[dict[str, str], dict[str, str]]:
        """Two episodes that are open in different workers."""
        first, second = self.open(**wanted), self.open(**wanted)
        assert {worker_of(first), worker_of(second)} == {0, 1}
        return first, second

    def episodes(self) -> int:
        """How many are open."""
        return httpx.get(f"{self.url}/healthz").json()["episodes"]


def worker_of(opened: dict[str, str]) -> int:
    return int(opened["episode_id"].partition(".")[0].removeprefix("w"))


@contextlib.contextmanager
def serving(command: list[str]) -> Generator[Served]:
    environ = os.environ | {"LAB_TOKEN": "ours"}
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environ, text=True) as process:
        assert process.stdout is not None
        try:
            yield Served(json.loads(process.stdout.readline())["listening"], process)
        finally:
            process.terminate()


@pytest.fixture(scope="module")
def host() -> Generator[Served]:
    words = ["serve", "--port", "0", "--workers", "2", "--max-episodes", str(MOST), "--token-env", "LAB_TOKEN"]
    with serving([sys.executable, "-m", "physment_mcp", *words]) as served:
        yield served


@pytest.fixture(autouse=True)
def closed(host: Served) -> Generator[None]:
    """Closes what a test has opened."""
    ids: list[str] = []
    original = Served.open

    def opening(self: Served, **wanted: Any) -> dict[str, str]:
        opened = original(self, **wanted)
        ids.append(opened["episode_id"])
        return opened

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Served, "open", opening)
        yield
    for name in ids:
        httpx.delete(f"{host.url}/episodes/{name}", headers=TOKEN)


async def test_clients_of_both_protocol_eras_reach_their_episode_on_new_and_on_shared_connections(
    host: Served,
) -> None:
    first, second = host.open_on_both()
    with anyio.fail_after(120):
        for mode in ("auto", "legacy"):
            for opened in (first, second):
                async with Client(opened["mcp_url"], mode=mode) as client:
                    assert not (await client.call_tool("step", {"duration": 0.5})).is_error
        async with httpx2.AsyncClient(headers=TOKEN, timeout=60) as shared:
            for mode in ("auto", "legacy"):
                for opened in (first, second):
                    transport = streamable_http_client(opened["mcp_url"], http_client=shared)
                    async with Client(transport, mode=mode) as client:
                        stepped = await client.call_tool("step", {"duration": 0.5})
        assert stepped.structured_content is not None
        assert stepped.structured_content["sim_time"] == 2.0


def test_one_connection_may_be_used_for_episodes_of_all_workers(host: Served) -> None:
    first, second = host.open_on_both()
    with httpx.Client(limits=httpx.Limits(max_connections=1), headers=TOKEN | ACCEPT) as http:
        for opened in (first, second, first):
            reply = http.post(opened["mcp_url"], json=HELLO)
            assert reply.status_code == 200
            assert "All kinds" not in reply.text
            assert "physment-mcp" in reply.text
        for opened in (first, second):
            assert http.delete(f"{host.url}/episodes/{opened['episode_id']}").status_code == 204
    assert host.episodes() == 0


def test_the_limit_of_episodes_holds_over_all_workers(host: Served) -> None:
    for _ in range(MOST):
        host.open()
    assert host.episodes() == MOST
    for _ in range(2):
        full = httpx.post(f"{host.url}/episodes", json={"scene": 7}, headers=TOKEN)
        assert full.status_code == 429
        assert f"{MOST} episodes are open" in full.json()["error"]


def test_tokens_hold_in_all_workers_and_on_forwarded_requests(host: Served) -> None:
    for _ in range(2):
        assert httpx.post(f"{host.url}/episodes", json={"scene": 7}).status_code == 401
    first, second = host.open_on_both(max_calls=5, guarded=True)
    with httpx.Client(limits=httpx.Limits(max_connections=1), headers=ACCEPT) as http:
        for opened, other in ((first, second), (second, first)):
            tokens = {None: 401, "nonsense": 401, other["player_token"]: 401, opened["player_token"]: 200}
            for token, status in tokens.items():
                headers = {} if token is None else {"Authorization": f"Bearer {token}"}
                assert http.post(opened["mcp_url"], json=HELLO, headers=headers).status_code == status
            log = f"{host.url}/episodes/{opened['episode_id']}/calls"
            assert http.get(log, headers={"Authorization": f"Bearer {opened['player_token']}"}).status_code == 401
            read = http.get(log, params={"start": 0}, headers={"Authorization": f"Bearer {opened['owner_token']}"})
            assert read.json() == {"ended": False, "calls": []}


def test_a_request_for_a_worker_that_does_not_exist_is_answered_as_for_a_closed_episode(host: Served) -> None:
    for name in ("w7.nothing", "w1.nothing", "w0.nothing", "nothing"):
        assert httpx.delete(f"{host.url}/episodes/{name}", headers=TOKEN).status_code == 404


async def test_a_worker_that_is_killed_costs_only_its_own_episodes_and_is_started_again(host: Served) -> None:
    first, second = host.open_on_both()
    lost, kept = (first, second) if worker_of(first) == 0 else (second, first)
    with anyio.fail_after(120):
        async with Client(kept["mcp_url"]) as client:
            before = host.workers()
            os.kill(before[0], signal.SIGKILL)
            assert not (await client.call_tool("step", {"duration": 0.5})).is_error
            async with Client(lost["mcp_url"]) as late:  # waits until the worker is there again
                gone = await late.call_tool("step", {"duration": 0.5})
            assert gone.is_error
            assert "there is no such episode" in gone.content[0].text
            assert not (await client.call_tool("step", {"duration": 0.5})).is_error
    assert host.episodes() == 1
    host.open_on_both()


def test_workers_end_with_their_front_however_it_ends(command: Command) -> None:
    words = command("serve", "--port", 0, "--workers", 2)
    with serving(words) as served:
        workers = served.workers()
        assert len(workers) == 2
        served.process.kill()
        served.process.wait()
        deadline = time.monotonic() + 120
        while any(alive(worker) for worker in workers):
            assert time.monotonic() < deadline, "a worker outlives its front"


def alive(number: int) -> bool:
    """Whether a process runs. One that has ended has no command line."""
    try:
        return bool(Path(f"/proc/{number}/cmdline").read_bytes())
    except OSError:
        return False


def test_more_workers_than_files_allow_are_refused_in_one_sentence(command: Command) -> None:
    done = subprocess.run(
        command("serve", "--port", 0, "--workers", 500),
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64)),
    )
    assert done.returncode == 2
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert line.startswith("physment-mcp: --workers 500: they cannot start: ")


def test_places_are_never_given_out_twice() -> None:
    memory = memoryview(bytearray(16)).cast("q")
    first, second = Places(3, memory, 0), Places(3, memory, 1)
    assert [first.take(), second.take(), first.take()] == [True] * 3
    assert not second.take()
    assert first.taken == second.taken == 3
    first.leave()
    assert second.take()
    assert not first.take()
