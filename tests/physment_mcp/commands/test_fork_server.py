"""Tests of episodes on stdio in processes forked from one process."""

import contextlib
import json
import socket
import subprocess
import sys
import tempfile
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from typing import IO

import pytest

from physment_mcp.commands.program import main

pytestmark = pytest.mark.skipif(not hasattr(socket, "send_fds"), reason="sockets cannot be passed here")

HELLO = {
    "jsonrpc": "2.0",
    "id": 1,
    "method": "initialize",
    "params": {"protocolVersion": "2025-06-18", "capabilities": {}, "clientInfo": {"name": "test", "version": "1"}},
}


@dataclass
class Forks:
    control: socket.socket
    process: subprocess.Popen[bytes]

    @contextlib.contextmanager
    def forked(self, first: bytes) -> Generator[tuple[socket.socket, IO[bytes]]]:
        """Fork one episode; yields the socket that is its stdin and stdout, and the file of its stderr."""
        ours, theirs = socket.socketpair()
        with ours, tempfile.TemporaryFile() as errors:
            with theirs:
                socket.send_fds(self.control, [b"\n"], [theirs.fileno(), errors.fileno()])
            ours.settimeout(60)
            ours.sendall(first)
            yield ours, errors


@pytest.fixture(scope="module")
def forks() -> Generator[Forks]:
    ours, theirs = socket.socketpair()
    with ours:
        with theirs:
            command = [sys.executable, "-m", "physment_mcp", "fork-server", "--control-fd", str(theirs.fileno())]
            process = subprocess.Popen(command, pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL)
        with process:
            yield Forks(ours, process)
            ours.shutdown(socket.SHUT_RDWR)
            assert process.wait(60) == 0


def words(*given: str) -> bytes:
    return json.dumps(given).encode() + b"\n"


def reply(connection: socket.socket, request: object = HELLO) -> object:
    connection.sendall(json.dumps(request).encode() + b"\n")
    with connection.makefile("rb") as lines:
        return json.loads(lines.readline())


def test_two_forks_are_two_episodes(forks: Forks) -> None:
    with forks.forked(words("--scene", "7")) as (one, _), forks.forked(words("--scene", "8")) as (other, _):
        assert "Physment" in str(reply(one)) or "physment" in str(reply(other))
        step = {"name": "step", "arguments": {"duration": 0.5}}
        for connection in (one, other):
            connection.sendall(json.dumps({"jsonrpc": "2.0", "method": "notifications/initialized"}).encode() + b"\n")
        called = reply(one, {"jsonrpc": "2.0", "id": 2, "method": "tools/call", "params": step})
        assert '"sim_time":0.5' in str(called).replace(" ", "")
        reading = {"name": "get_velocity", "arguments": {"object_id": "object_1"}}
        still = reply(other, {"jsonrpc": "2.0", "id": 3, "method": "tools/call", "params": reading})
        assert '"sim_time":0.0' in str(still).replace(" ", "")


@pytest.mark.parametrize(
    ("first", "said"),
    [
        (words("--scene", "9999"), "scene 9999"),
        (words("--nonsense"), "there is no option --nonsense"),
        (b"no list\n", "JSONDecodeError"),
    ],
)
def test_a_fork_with_wrong_words_ends_alone_and_says_why(forks: Forks, first: bytes, said: str) -> None:
    with forks.forked(first) as (connection, errors):
        with contextlib.suppress(ConnectionResetError):
            assert connection.recv(1) == b""
        errors.seek(0)
        assert said in errors.read().decode()
    assert forks.process.poll() is None


@pytest.mark.parametrize("descriptor", ["0", "99", "-1"])
def test_a_descriptor_that_is_no_socket_is_refused(descriptor: str, capsys: pytest.CaptureFixture[str]) -> None:
    given: Sequence[str] = ["fork-server", f"--control-fd={descriptor}"]
    assert main(given) == 2
    assert "is not the descriptor of an open Unix socket" in capsys.readouterr().err
