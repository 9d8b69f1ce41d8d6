"""Connections of the host: how many may be open, how long a client may take to say what it wants, who goes first.

Knows ASGI. Knows no episodes and no MCP.
"""

import logging
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import anyio
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from physment_mcp.serving.gate import refuse

logger = logging.getLogger(__name__)

REQUEST_S = 15.0
"""Wall time from the opening of a connection, or from the first byte of a request, to the end of its headers [s]."""
BODY_S = 15.0
"""Wall time from the headers of a request to the end of its body [s]."""
_WARN_S = 60.0
"""Shortest wall time between two warnings that connections are turned away [s]."""


@dataclass(slots=True)
class Connections:
    """The open connections, in all and of each address."""

    most: int
    most_of_address: int
    _open: Counter[str] = field(default_factory=Counter[str])
    _warned_at: float = -_WARN_S

    def enter(self, address: str) -> bool:
        """Count a new connection; returns False, and does not count it, if there are too many."""
        if self._open.total() < self.most and self._open[address] < self.most_of_address:
            self._open[address] += 1
            return True
        if time.monotonic() - self._warned_at >= _WARN_S:
            self._warned_at = time.monotonic()
            logger.warning(
                "connections are turned away: %d are open, %d of them from %s (at most %d and %d)",
                *(self._open.total(), self._open[address], address, self.most, self.most_of_address),
            )
        return False

    def leave(self, address: str) -> None:
        """A connection that was counted is closed."""
        self._open[address] -= 1
        if not self._open[address]:
            del self._open[address]


class EpisodesFirst:
    """Lets requests that reach no open episode in one after another, so that many of them delay an episode little.

    Between two of them, the event loop serves whatever else is ready. The next does not wait for the end of the one
    before, because opening an episode takes long.
    """

    def __init__(self, app: ASGIApp, reaches_episode: Callable[[str], bool]) -> None:
        """Set up.

        Args:
            app: The application behind.
            reaches_episode: Whether a path belongs to an open episode.
        """
        self._app = app
        self._reaches_episode = reaches_episode
        self._entrance = anyio.Semaphore(1)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, when it is its turn."""
        if scope["type"] == "http" and not self._reaches_episode(scope["path"]):
            async with self._entrance:
                pass
        await self._app(scope, receive, send)


class BodyGate:
    """Reads the body of a request before anything else is done with it, within bounds of size and time."""

    def __init__(self, app: ASGIApp, most: int, within_s: float = BODY_S) -> None:
        """Set up.

        Args:
            app: The application behind the gate; it gets the body in one piece.
            most: Largest accepted body [bytes].
            within_s: As `BODY_S`.
        """
        self._app = app
        self._most = most
        self._within_s = within_s

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it: 413 if its body is too large, 408 if it takes too long."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        body = bytearray()
        complete = False
        with anyio.move_on_after(self._within_s):
            while not complete and len(body) <= self._most:
                message = await receive()
                if message["type"] == "http.disconnect":
                    logger.info("an upload was broken off after %d bytes", len(body))
                    return
                body += message.get("body", b"")
                complete = not message.get("more_body", False)
        if len(body) > self._most:
            await refuse(413, f"a request has at most {self._most} bytes")(scope, receive, send)
        elif not complete:
            await refuse(408, f"the request took longer than {self._within_s:g} s")(scope, receive, send)
        else:
            await self._app(scope, with_body(bytes(body), receive), send)


def with_body(body: bytes, receive: Receive) -> Receive:
    """What an application receives of a request whose body was read: the body, then whatever the connection brings."""
    first: list[Message] = [{"type": "http.request", "body": body, "more_body": False}]

    async def next_message() -> Message:
        return first.pop() if first else await receive()

    return next_message
