"""Episodes on a host that this process started: each over a Unix socket of its own.

This process holds one end of a control socket, and the host the other. For each episode, this process makes a pair of
sockets and sends one of them through the control socket. The first line is the request for the episode; after the reply
to it, all lines are MCP messages. An episode is closed with its socket.
"""

import contextlib
import json
from collections.abc import AsyncGenerator, Sequence
from dataclasses import dataclass
from typing import Any

import anyio
from mcp import Client
from mcp.client.extension import ClientExtension

from evaluator.episode.passed_sockets import ControlSocket, Messages, passed
from evaluator.errors import InfrastructureError

_OPEN_S = 60.0
"""Longest wall time for the opening of an episode [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class HostSockets:
    """Opens episodes through the control socket of a host."""

    control: ControlSocket

    @contextlib.asynccontextmanager
    async def episode(
        self, wanted: dict[str, int], timeout_s: float, declared: Sequence[ClientExtension] = ()
    ) -> AsyncGenerator[Client]:
        """A connected client of a new episode, which is closed afterwards.

        Args:
            wanted: What `POST /episodes` takes.
            timeout_s: Longest wall time of a call [s].
            declared: Extensions of MCP that the client declares.

        Raises:
            InfrastructureError: The host is gone, or opens no episode.
        """
        async with contextlib.AsyncExitStack() as stack:
            try:
                messages = await stack.enter_async_context(passed(self.control))
            except OSError as error:
                raise InfrastructureError(f"the local host cannot be reached: {error.strerror or error}") from error
            await _request(messages, wanted)
            yield await stack.enter_async_context(messages.client(timeout_s, declared))


async def _request(messages: Messages, wanted: dict[str, int]) -> None:
    """Ask for an episode.

    Raises:
        InfrastructureError: The host did not open it.
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
