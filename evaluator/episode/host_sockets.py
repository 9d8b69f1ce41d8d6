"""Episodes on a host that this process started: each over a Unix socket of its own, one JSON line a message.

This process holds one end of a control socket, and the host the other. For each episode, this process makes a pair of
sockets and sends one of them through the control socket. The first line is the request for the episode; after the reply
to it, all lines are MCP messages. An episode is closed with its socket.

"""

import asyncio
import contextlib
import json
import socket
from collections.abc import AsyncGenerator
from dataclasses import dataclass
from types import TracebackType
from typing import Any, Self

import anyio
import mcp_types as types
from mcp import Client
from mcp.client._transport import TransportStreams
from mcp.shared.message import SessionMessage

from evaluator.errors import InfrastructureError

AVAILABLE = hasattr(socket, "send_fds")
"""Whether this system passes sockets between processes; Windows does not."""
_MAX_LINE = 64 * 2**20
"""Longest accepted line [bytes]: results may hold pictures."""
_OPEN_S = 60.0
"""Longest wall time for the opening of an episode [s]."""
_CLOSE_S = 5.0
"""Longest wall time for the host to let go of an episode [s]."""


@dataclass(slots=True, eq=False)
class _Messages:
    """A socket as the pair of streams that MCP sessions use. It is closed by whoever made it."""

    reader: asyncio.StreamReader
    writer: asyncio.StreamWriter

    async def receive(self) -> SessionMessage | Exception:
        """The next message, or why a line is none.

        Raises:
            anyio.EndOfStream: The host has closed the episode, or is gone.
        """
        try:
            line = await self.reader.readline()
        except (OSError, ValueError):
            raise anyio.EndOfStream from None
        if not line.endswith(b"\n"):
            raise anyio.EndOfStream
        try:
            return SessionMessage(types.jsonrpc_message_adapter.validate_json(line, by_name=False))
        except ValueError as error:
            return error

    async def send(self, item: SessionMessage, /) -> None:
        """Write a message; waits while the host does not read."""
        written = item.message.model_dump_json(by_alias=True, exclude_unset=True)
        try:
            self.writer.write(written.encode() + b"\n")
            await self.writer.drain()
        except OSError as error:
            raise anyio.BrokenResourceError from error

    async def aclose(self) -> None:
        """Nothing: the socket is closed as a whole, when the episode ends."""

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> SessionMessage | Exception:
        try:
            return await self.receive()
        except anyio.EndOfStream:
            raise StopAsyncIteration from None

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, exc_type: type[BaseException] | None, exc_val: BaseException | None, exc_tb: TracebackType | None
    ) -> None:
        await self.aclose()


@dataclass(frozen=True, slots=True, eq=False)
class HostSockets:
    """Opens episodes through the control socket of a host."""

    control: socket.socket

    @contextlib.asynccontextmanager
    async def episode(self, wanted: dict[str, int], timeout_s: float) -> AsyncGenerator[Client]:
        """A connected client of a new episode, which is closed afterwards.

        Args:
            wanted: What `POST /episodes` takes.
            timeout_s: Longest wall time of a call [s].

        Raises:
            InfrastructureError: The host is gone, or opens no episode.
        """
        async with self._opened(wanted) as messages:
            streams: TransportStreams = (messages, messages)
            async with Client(contextlib.nullcontext(streams), read_timeout_seconds=timeout_s, cache=None) as client:
                yield client

    @contextlib.asynccontextmanager
    async def _opened(self, wanted: dict[str, int]) -> AsyncGenerator[_Messages]:
        try:
            reader, writer = await self._connection()
        except OSError as error:
            raise InfrastructureError(f"the local host cannot be reached: {error.strerror or error}") from error
        try:
            await _request(reader, writer, wanted)
            yield _Messages(reader, writer)
        finally:
            with contextlib.suppress(OSError):
                writer.write_eof()
            # The host closes its end once it has let go of the episode, so the next one has room.
            with anyio.move_on_after(_CLOSE_S, shield=True), contextlib.suppress(OSError):
                while await reader.read(_MAX_LINE):
                    pass
            writer.close()

    async def _connection(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        """A new connection to the host.

        Raises:
            OSError: The host is gone, or too many files are open.
        """
        ours, theirs = socket.socketpair()
        try:
            with theirs:
                await self._send(theirs)
            return await asyncio.open_connection(sock=ours, limit=_MAX_LINE)
        except BaseException:
            ours.close()
            raise

    async def _send(self, connection: socket.socket) -> None:
        while True:
            try:
                socket.send_fds(self.control, [b"\n"], [connection.fileno()])
            except BlockingIOError:
                await anyio.wait_writable(self.control)
            else:
                return


async def _request(reader: asyncio.StreamReader, writer: asyncio.StreamWriter, wanted: dict[str, int]) -> None:
    """Ask for an episode.

    Raises:
        InfrastructureError: The host did not open it.
    """
    reply: Any = None
    with anyio.move_on_after(_OPEN_S), contextlib.suppress(OSError, ValueError):
        writer.write(json.dumps(wanted).encode() + b"\n")
        reply = json.loads(await reader.readline())
    match reply:
        case {"opened": True}:
            return
        case {"error": str(sentence)}:
            raise InfrastructureError(f"the local host opened no episode: {sentence}")
        case _:
            raise InfrastructureError(
                "the local host cannot be reached: it did not reply to the request for an episode"
            )
