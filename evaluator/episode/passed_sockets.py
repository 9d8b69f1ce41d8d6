"""Sockets that are passed to a process of our own, one for each episode, with one JSON line a message. POSIX only."""

import asyncio
import contextlib
import socket
from collections.abc import AsyncGenerator, Sequence
from dataclasses import dataclass, field

import anyio
from mcp import Client
from mcp.client._transport import TransportStreams
from mcp.client.extension import ClientExtension

from physment_mcp.contract.line_stream import LineStream

AVAILABLE = hasattr(socket, "send_fds")
"""Whether this system passes sockets between processes; Windows does not."""
_MAX_LINE = 64 * 2**20
"""Longest accepted line [bytes]: results may hold pictures."""
_CLOSE_S = 5.0
"""Longest wall time for the other process to let go of an episode [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class ControlSocket:
    """Our end of the socket through which sockets are passed to a process. It is closed by whoever made it."""

    socket: socket.socket
    """It does not block."""
    _turn: anyio.Lock = field(default_factory=anyio.Lock)

    async def send(self, descriptors: Sequence[int]) -> None:
        """Pass sockets and files; waits while the process has not taken earlier ones.

        Raises:
            OSError: The process is gone, or too many files are open.
        """
        async with self._turn:  # only one task may wait for a socket
            while True:
                try:
                    socket.send_fds(self.socket, [b"\n"], descriptors)
                except BlockingIOError:
                    await anyio.wait_writable(self.socket)
                else:
                    return

    def close(self) -> None:
        """Close it, which tells the process that no more will come."""
        self.socket.close()


class Messages(LineStream):
    """A socket that was passed, as the streams of an MCP client."""

    @contextlib.asynccontextmanager
    async def client(self, timeout_s: float, declared: Sequence[ClientExtension] = ()) -> AsyncGenerator[Client]:
        """An MCP client that is connected over this socket.

        Args:
            timeout_s: Longest wall time of a call [s].
            declared: Extensions of MCP that it declares.
        """
        streams: TransportStreams = (self, self)
        transport = contextlib.nullcontext(streams)
        async with Client(transport, read_timeout_seconds=timeout_s, cache=None, extensions=declared) as client:
            yield client


@contextlib.asynccontextmanager
async def passed(control: ControlSocket, *more: int) -> AsyncGenerator[Messages]:
    """A new connection to the process at the other end of a control socket, which is closed afterwards.

    Args:
        control: Our end of the socket that reaches it.
        more: Descriptors that are sent along.

    Raises:
        OSError: The process is gone, or too many files are open.
    """
    ours, theirs = socket.socketpair()
    try:
        with theirs:
            await control.send([theirs.fileno(), *more])
        reader, writer = await asyncio.open_connection(sock=ours, limit=_MAX_LINE)
    except BaseException:
        ours.close()
        raise
    try:
        yield Messages(reader, writer)
    finally:
        with contextlib.suppress(OSError):
            writer.write_eof()
        # The other process closes its end once it has let go of the episode, so the next one has room.
        with anyio.move_on_after(_CLOSE_S, shield=True), contextlib.suppress(OSError):
            while await reader.read(_MAX_LINE):
                pass
        writer.close()
