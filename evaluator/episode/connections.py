"""Connections to our servers: sockets passed to a child process, and the errors of connections that fail.

A passed socket serves one episode and carries one JSON message per line; POSIX only. Connection failures become errors
of this package, with the cause or the server's last output.
"""

import asyncio
import contextlib
import socket
import ssl
from collections.abc import AsyncGenerator, Iterator, Sequence
from dataclasses import dataclass, field
from typing import IO, cast

import anyio
import httpx2
from mcp.client import Client, ClientExtension
from mcp.client._transport import TransportStreams

from evaluator.errors import EvaluatorError, InfrastructureError
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


_WORDED: tuple[tuple[type[Exception], str], ...] = (
    (socket.gaierror, "no machine of that name is known"),
    (ssl.SSLError, "no secure connection can be made: its certificate is not trusted, or it does not speak TLS"),
    (FileNotFoundError, "there is no such program"),
    (PermissionError, "it may not be executed"),
    (
        httpx2.ConnectError,
        "nothing accepts connections there; start `physment-mcp serve` there, or correct the address",
    ),
    (httpx2.TimeoutException, "it did not answer in time"),
)
"""Messages for exceptions of Python and its libraries, whose own messages name no server; most specific first."""


def server_failure(what: str, error: Exception, errors: IO[str]) -> InfrastructureError:
    """Build the error for a server process that failed, with the last line that it wrote.

    Args:
        what: What failed, as a clause.
        error: Exception that the client raised.
        errors: Captured stderr of the process.
    """
    errors.seek(0)
    lines = [line.strip() for line in errors.read().splitlines() if line.strip()]
    return InfrastructureError(f"{what}: {lines[-1] if lines else reason(first_error(error))}")


def reason(error: BaseException) -> str:
    """Explain in a clause why a server cannot be reached."""
    causes = list(_causes(error))
    worded = (clause for kind, clause in _WORDED if any(isinstance(cause, kind) for cause in causes))
    return next(worded, str(error) or repr(error))


def _causes(error: BaseException | None) -> Iterator[BaseException]:
    """Yield an error and its chain of causes."""
    while error is not None:
        yield error
        error = error.__cause__


def own_error(error: Exception, *kinds: type[EvaluatorError]) -> EvaluatorError | None:
    """Return the wrapped error if it is of one of these types, otherwise None."""
    first = first_error(error)
    return first if isinstance(first, kinds) else None


def first_error(error: BaseException) -> BaseException:
    """Return the first error inside nested exception groups."""
    if isinstance(error, BaseExceptionGroup):
        parts = cast(BaseExceptionGroup[BaseException], error).exceptions
        return first_error(parts[0])
    return error


def without_seed(error: EvaluatorError, drawn: int, seed: int) -> EvaluatorError:
    """Remove a held-back seed from an error message, because records must not contain it.

    Args:
        error: The error.
        drawn: The secret seed from which the variant was sampled.
        seed: The seed as recorded.
    """
    if drawn == seed or str(drawn) not in str(error):
        return error
    return InfrastructureError(str(error).replace(str(drawn), f"(variant {seed})"))
