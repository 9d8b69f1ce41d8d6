"""An episode server that this process starts and that ends with it, and its episodes, each over its own Unix socket.

This process and the server hold the two ends of a control socket. For each episode, this process creates a socket pair
and sends one end through the control socket. The first line on the new socket is the request for the episode. After
the server's reply, every line is an MCP message. Closing the socket closes the episode.
"""

import contextlib
import json
import socket
import subprocess
import sys
from collections.abc import AsyncGenerator, Sequence
from dataclasses import dataclass
from typing import IO, Any

import anyio
from mcp import Client
from mcp.client.extension import ClientExtension

from evaluator.episode.passed_sockets import AVAILABLE, ControlSocket, Messages, passed
from evaluator.errors import InfrastructureError


def start_host(
    options: Sequence[str], token: str | None, errors: IO[str]
) -> tuple[subprocess.Popen[str], ControlSocket | None]:
    """Start an episode server on a free port. It prints its address as the first line.

    Args:
        options: Options of `physment-mcp serve`.
        token: Token required to open episodes over HTTP; None if any program on this machine may open them.
        errors: File that captures its stderr.

    Returns:
        The process, whose stdin is a pipe that the operating system closes even if this process is killed; and the
        control socket that opens episodes on it, None if the system cannot pass sockets between processes.

    Raises:
        OSError: The operating system cannot create another process or file.
    """
    command = [sys.executable, "-m", "physment_mcp", "serve", "--port", "0", "--end-with-stdin", *options]
    if not AVAILABLE:
        return _started(command, (), token, errors), None
    ours, theirs = socket.socketpair()
    try:
        ours.setblocking(False)
        with theirs:
            command += ["--control-fd", str(theirs.fileno())]
            return _started(command, [theirs.fileno()], token, errors), ControlSocket(ours)
    except BaseException:
        ours.close()
        raise


def _started(
    command: Sequence[str], inherited: Sequence[int], token: str | None, errors: IO[str]
) -> subprocess.Popen[str]:
    process = subprocess.Popen(  # noqa: S603 - our own server
        [*command, *(["--token-stdin"] if token else [])],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=errors,
        text=True,
        pass_fds=inherited,
    )
    assert process.stdin is not None
    if token:
        # Not in an environment variable, which other programs of this user could read.
        with contextlib.suppress(BrokenPipeError):  # the process has exited; its last output line is reported
            process.stdin.write(f"{token}\n")
            process.stdin.flush()
    return process


_OPEN_S = 60.0
"""Longest wall time for opening an episode [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class HostSockets:
    """Opens episodes through the control socket of an episode server."""

    control: ControlSocket

    @contextlib.asynccontextmanager
    async def episode(
        self, wanted: dict[str, int], timeout_s: float, declared: Sequence[ClientExtension] = ()
    ) -> AsyncGenerator[Client]:
        """Open an episode and return its client; the episode is closed afterwards.

        Args:
            wanted: Request body of `POST /episodes`.
            timeout_s: Longest wall time of a call [s].
            declared: MCP extensions that the client declares.

        Raises:
            InfrastructureError: The server is gone, or did not open the episode.
        """
        async with contextlib.AsyncExitStack() as stack:
            try:
                messages = await stack.enter_async_context(passed(self.control))
            except OSError as error:
                raise InfrastructureError(f"the local host cannot be reached: {error.strerror or error}") from error
            await _request(messages, wanted)
            yield await stack.enter_async_context(messages.client(timeout_s, declared))


async def _request(messages: Messages, wanted: dict[str, int]) -> None:
    """Request an episode.

    Raises:
        InfrastructureError: The server did not open it.
    """
    reply: Any = None
    with anyio.move_on_after(_OPEN_S), contextlib.suppress(OSError, ValueError):
        messages.write(wanted)
        reply = json.loads(await messages.reader.readline())
    match reply:
        case {"opened": True}:
            return
        case {"error": str(sentence)}:
            raise InfrastructureError(f"the local host opened no episode: {sentence}")
        case _:
            raise InfrastructureError(
                "the local host cannot be reached: it did not reply to the request for an episode"
            )
