"""Sockets passed to a child process, one per episode, that carry one JSON message per line. POSIX only."""

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
"""Whether this system can pass sockets between processes; Windows cannot."""
_MAX_LINE = 64 * 2**20
"""Longest accepted line [bytes]; results may contain images."""
_CLOSE_S = 5.0
"""Longest wall time for the other process to close an episode [s]."""


@dataclass(frozen=True, slots=True, eq=False)
class ControlSocket:
    """Our end of the socket through which sockets are passed to a process. The creator closes it."""

    socket: socket.socket
    """A non-blocking socket."""
    _turn: anyio.Lock = field(default_factory=anyio.Lock)

    async def send(self, descriptors: Sequence[int]) -> None:
        """Pass sockets and files to the process; waits while the socket's buffer is full.

        Raises:
            OSError: The process is gone, or the limit on open files is reached.
        """
        async with self._turn:  # anyio allows only one task to wait for a socket
            while True:
                try:
                    socket.send_fds(self.socket, [b"\n"], descriptors)
                except BlockingIOError:
                    await anyio.wait_writable(self.socket)
                else:
                    return

    def close(self) -> None:
        """Close the socket, after which the process expects no more sockets."""
        self.socket.close()


class Messages(LineStream):
    """A passed socket, as the streams of an MCP client."""

    @contextlib.asynccontextmanager
    async def client(self, timeout_s: float, declared: Sequence[ClientExtension] = ()) -> AsyncGenerator[Client]:
        """Connect an MCP client over this socket.

        Args:
            timeout_s: Longest wall time of a call [s].
            declared: MCP extensions that the client declares.
        """
        streams: TransportStreams = (self, self)
        transport = contextlib.nullcontext(streams)
        async with Client(transport, read_timeout_seconds=timeout_s, cache=None, extensions=declared) as client:
            yield client


@contextlib.asynccontextmanager
async def passed(control: ControlSocket, *more: int) -> AsyncGenerator[Messages]:
    """Open a connection to the process at the other end of a control socket, and close it afterwards.

    Args:
        control: Our end of the control socket.
        more: File descriptors to send along with the socket.

    Raises:
        OSError: The process is gone, or the limit on open files is reached.
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
        # Wait until the other process has closed the episode, so that the next one can be opened.
        with anyio.move_on_after(_CLOSE_S, shield=True), contextlib.suppress(OSError):
            while await reader.read(_MAX_LINE):
                pass
        writer.close()
