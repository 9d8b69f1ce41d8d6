"""Serves episodes to the program that started this server: each on its own Unix socket, each message a line of JSON.

The program holds one end of a control socket; this process inherited the other. For each episode the program creates a
socket pair and sends one end through the control socket. The first line is the request for the episode; the reply is
`{"opened": true}` or an error. All further lines are MCP messages. Closing the socket closes the episode. The sockets
have no address, so no other program can connect, and a killed process leaves nothing behind.
"""

import asyncio
import contextlib
import logging
import socket
import time
from collections.abc import AsyncGenerator, Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import anyio
from mcp.server.runner import modern_on_request
from mcp.shared.dispatcher import DispatchContext, OnRequest
from mcp.shared.jsonrpc_dispatcher import JSONRPCDispatcher
from mcp.shared.message import SessionMessage
from mcp.shared.transport_context import TransportContext

from physment_mcp.contract.line_stream import LineStream
from physment_mcp.errors import NotOpened
from physment_mcp.scene import Scene
from physment_mcp.serving.admission import Admission
from physment_mcp.serving.http_guard import MAX_BODY
from physment_mcp.serving.scheduling import Scheduler, Turns
from physment_mcp.serving.server import build_server
from physment_mcp.serving.slot import EpisodeSlot
from physment_mcp.serving.views import Frames
from physment_mcp.session import Session
from physment_mcp.visibility import Visibility

logger = logging.getLogger(__name__)

_REQUEST_S = 15.0
"""Deadline for the first line [s]."""
_CLOSED = "the connection of this episode was closed"


@dataclass(slots=True, eq=False)
class _Lines(LineStream):
    """The connection of an episode."""

    last_used: float = field(default_factory=time.monotonic)
    in_flight: int = 0
    """Number of requests that are being served."""

    async def request(self) -> bytes | None:
        """The first line; None if it is late or too long, or if the socket is closed."""
        with anyio.move_on_after(_REQUEST_S), contextlib.suppress(OSError, ValueError):
            line = await self.reader.readline()
            return line if line.endswith(b"\n") else None
        return None

    async def receive(self) -> SessionMessage | Exception:
        """Receive a message as `LineStream.receive` does, and record the time of last use."""
        message = await LineStream.receive(self)  # a dataclass with slots cannot call super() without arguments
        self.last_used = time.monotonic()
        return message

    def too_long(self) -> None:
        logger.warning("an episode is closed: a line on its socket had more than %d bytes", MAX_BODY)


class SocketEpisodes:
    """Serves the episodes on sockets."""

    def __init__(
        self,
        admission: Admission,
        watch: Callable[[Session], Frames] | None,
        find_visibility: Callable[[Scene], Visibility],
        scheduler: Scheduler,
    ) -> None:
        """Create the service without episodes.

        Args:
            admission: Object that opens the sessions of the episodes.
            watch: Function that creates the source of frames for results; None for results without frames.
            find_visibility: Function that returns the visibility of a scene, for clients that show the app.
            scheduler: Scheduler that all episodes of the server share.
        """
        self._admission = admission
        self._watch = watch
        self._find_visibility = find_visibility
        self._scheduler = scheduler
        self._open: dict[_Lines, anyio.CancelScope] = {}

    async def serve(self, control: socket.socket) -> None:
        """Serve an episode on each socket that is received, until the other end of the control socket is closed."""
        control.setblocking(False)
        async with anyio.create_task_group() as tasks:
            while True:
                await anyio.wait_readable(control)
                try:
                    mark, brought, _, _ = socket.recv_fds(control, 1, 1)
                except BlockingIOError:
                    continue
                except OSError as error:
                    logger.warning("no more episodes are opened on sockets: %s", error.strerror)
                    return
                if not mark:
                    return
                if brought:
                    tasks.start_soon(self._serve_one, socket.socket(fileno=brought[0]))
                else:
                    # The system has closed the socket, which the program notices at the other end.
                    logger.warning("an episode is not opened: more files than the system allows would be open")

    def expire(self, oldest: float) -> int:
        """Close the episodes that were last used before a time; returns their number.

        Args:
            oldest: Time on the monotonic clock [s].
        """
        expired = [scope for lines, scope in self._open.items() if not lines.in_flight and lines.last_used < oldest]
        for scope in expired:
            scope.cancel()
        return len(expired)

    async def _serve_one(self, connection: socket.socket) -> None:
        try:
            async with _lines_of(connection) as lines:
                request = await lines.request()
                if request is not None:
                    await self._open_and_play(lines, request)
        except Exception as crash:  # an error in our code must not end the other episodes
            # The traceback may name hidden things, so it is not logged at the default level.
            logger.error("an episode on a socket failed: %s", type(crash).__name__)  # noqa: TRY400
            logger.debug("traceback", exc_info=True)

    async def _open_and_play(self, lines: _Lines, request: bytes) -> None:
        try:
            _, session = await self._admission.open(request)
        except NotOpened as refusal:
            lines.write({"status": refusal.status, "error": str(refusal)})
            return
        try:
            await self._play(lines, session)
        finally:
            self._admission.quota.release()

    async def _play(self, lines: _Lines, session: Session) -> None:
        """Serve a session until its socket is closed or it expires."""
        slot = EpisodeSlot(session, watch=self._watch, find_visibility=self._find_visibility, scheduler=self._scheduler)
        server = build_server(slot)
        lines.write({"opened": True})
        try:
            with anyio.CancelScope() as self._open[lines]:
                async with server.lifespan(server) as state:
                    serve = _in_turn(lines, slot.turns, modern_on_request(server, state))
                    await JSONRPCDispatcher(lines, lines).run(serve, _ignore)
        finally:
            self._open.pop(lines, None)
            slot.close(_CLOSED)


def _in_turn(lines: _Lines, turns: Turns, serve: OnRequest) -> OnRequest:
    """Serve the requests of an episode in turn, as over HTTP, and count the requests in flight."""

    async def served(
        context: DispatchContext[TransportContext], method: str, params: Mapping[str, Any] | None
    ) -> dict[str, Any]:
        lines.in_flight += 1
        try:
            async with turns.turn():
                return await serve(context, method, params)
        finally:
            lines.in_flight -= 1
            lines.last_used = time.monotonic()

    return served


async def _ignore(_context: DispatchContext[TransportContext], _method: str, _params: Mapping[str, Any] | None) -> None:
    """Ignore a notification; the dispatcher itself handles cancellations."""


@contextlib.asynccontextmanager
async def _lines_of(connection: socket.socket) -> AsyncGenerator[_Lines]:
    """Return the streams of a socket, and close the socket afterwards. Data already written still arrives."""
    reader, writer = await asyncio.open_connection(sock=connection, limit=MAX_BODY)
    try:
        yield _Lines(reader, writer)
    finally:
        writer.close()
