"""A host on its port: uvicorn, with bounds on the number of connections and on the time that headers take.

Importing this imports uvicorn, which takes half a second, and which episodes on stdio do not need.
"""

import asyncio
import contextlib
import ctypes
import gc
import json
import logging
import socket
import sys
import time
from collections import Counter
from collections.abc import Sized
from dataclasses import dataclass, field
from typing import Any

import uvicorn
from uvicorn.protocols.http.auto import AutoHTTPProtocol
from uvicorn.protocols.http.flow_control import FlowControl

from physment_mcp.serving.host import Host

logger = logging.getLogger(__name__)

REQUEST_S = 15.0
"""Wall time from the opening of a connection, or from the first byte of a request, to the end of its headers [s]."""
_KEEP_ALIVE_S = 60
"""How long an idle connection is kept [s]: longer than by clients (5 s), so that none is closed just as it is used."""
_CONNECTIONS_EACH = 8
"""Open connections for each episode that may be open: a client that plays one uses two or three."""
_MORE_CONNECTIONS = 100
"""Open connections besides these."""
_READ = 2048
"""Bytes that are read of a connection before others are looked at: all requests among them are parsed at once."""
_ACCEPTED_AT_ONCE = 8
"""Connections that are accepted before requests on open ones are looked at again."""
_WARN_S = 60.0
"""Shortest wall time between two warnings that connections are turned away [s]."""
_WAITING = 1024
"""Connections that may wait to be accepted."""

_NEW_OBJECTS = (2_000, 5, 50)
"""Thresholds of the garbage collector: generation 0 after 2,000 allocations (1 to 2 ms), generation 1 after 5
collections of generation 0 (5 ms), generation 2 after 50 of generation 1, if its objects have become more by a
quarter."""
_M_MMAP_THRESHOLD, _LARGE = -3, 128 * 1024
"""The parameter of glibc's `mallopt`, and the size from which memory is a mapping of its own [bytes]."""


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


def listen(address: str, port: int) -> socket.socket:
    """Listen on an address.

    Raises:
        OSError: The system does not allow it.
    """
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    listener = socket.create_server((address.strip("[]"), port), family=family, backlog=_WAITING)
    # Every connection inherits this. Otherwise the system holds small packets back, which costs 40 ms a call.
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return listener


def announce(listener: socket.socket) -> None:
    """Print the address as one line of JSON; it names the port that was chosen."""
    bound, chosen = listener.getsockname()[:2]
    shown = f"[{bound}]" if ":" in bound else bound
    print(json.dumps({"listening": f"http://{shown}:{chosen}"}), flush=True)  # noqa: T201 - the command's output


def serve(host: Host, address: str, port: int) -> None:
    """Serve until interrupted. Prints one line of JSON with the address, which names the port that was chosen.

    Raises:
        OSError: The system does not allow listening on this address.
    """
    listener = listen(address, port)
    announce(listener)
    _run(PatientServer(_config(host)), [listener])


def _run(server: uvicorn.Server, sockets: list[socket.socket]) -> None:
    """Serve until interrupted, and look for garbage only in what was made since the start, a little at a time.

    Every episode waits for such a search. It would take 30 to 70 ms in all modules, and as long in 200 000 new objects.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(*_NEW_OBJECTS)
    _give_memory_back()
    server.run(sockets)


def _give_memory_back() -> None:
    """Let glibc give the memory of a closed episode back to the system at once.

    Its data are some hundred kilobytes. By default glibc soon keeps such blocks in its heap. The heap then grows by
    20 kB for each episode that expires, because blocks do not fit into each other's gaps.
    """
    if sys.platform == "linux":
        mallopt = getattr(ctypes.CDLL(None), "mallopt", None)  # other C libraries than glibc have none
        if mallopt is not None:
            mallopt(_M_MMAP_THRESHOLD, _LARGE)


def _config(host: Host) -> uvicorn.Config:
    most = _CONNECTIONS_EACH * host.max_episodes + _MORE_CONNECTIONS
    return uvicorn.Config(
        host.app(),
        http=bounded_protocol(Connections(most, most * 3 // 4)),
        backlog=_ACCEPTED_AT_ONCE,
        log_config=None,  # as all other lines
        log_level="warning",
        timeout_graceful_shutdown=2,
        timeout_keep_alive=_KEEP_ALIVE_S,
    )


class PatientServer(uvicorn.Server):
    """Accepts `Config.backlog` connections at once, and lets more wait, where uvicorn has one number for both."""

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Begin to accept connections."""
        await super().startup(sockets)
        for listener in sockets or ():
            listener.listen(_WAITING)


def bounded_protocol(connections: Connections, request_s: float = REQUEST_S) -> type[asyncio.Protocol]:
    """The protocol for one host.

    Args:
        connections: Counts its connections.
        request_s: As `REQUEST_S`.
    """
    return type("HostProtocol", (_BoundedProtocol,), {"open_connections": connections, "request_s": request_s})


class _Reading(FlowControl):
    """Reads no more of a connection while requests that were read wait for their turn.

    uvicorn reads on whenever the application awaits a part of a request, so that all requests of the connection, which
    may be thousands, would be parsed and kept.
    """

    def __init__(self, transport: asyncio.Transport, waiting: Sized) -> None:
        super().__init__(transport)
        self._waiting = waiting

    def resume_reading(self) -> None:
        """Read, unless requests wait."""
        if not self._waiting:
            super().resume_reading()


class _BoundedProtocol(AutoHTTPProtocol):
    """One connection."""

    open_connections: Connections
    request_s: float
    _address: str | None = None
    """Where it comes from; None while it is not counted."""
    _deadline: asyncio.TimerHandle | None = None
    _transport: Any = None

    def connection_made(self, transport: Any) -> None:
        """Count the connection, or close it at once if there are too many."""
        peer = transport.get_extra_info("peername")
        address = str(peer[0]) if peer else ""
        self._transport = transport
        with contextlib.suppress(AttributeError):  # other event loops than asyncio's read as much as they like
            transport.max_size = _READ
        super().connection_made(transport)
        waiting = getattr(self, "pipeline", None)  # uvicorn's other parser, h11, stops by itself
        if waiting is not None:
            self.flow = _Reading(transport, waiting)
        if self.open_connections.enter(address):
            self._address = address
            self._wait()
        else:
            transport.abort()

    def data_received(self, data: bytes) -> None:
        """Time the headers of a request, from its first byte on."""
        if self._deadline is None and not self._in_request():
            self._wait()
        super().data_received(data)
        if self._in_request() and self._deadline is not None:
            self._deadline.cancel()
            self._deadline = None

    def connection_lost(self, exc: Exception | None) -> None:
        """Stop counting it."""
        if self._deadline is not None:
            self._deadline.cancel()
        if self._address is not None:
            self.open_connections.leave(self._address)
            self._address = None
        super().connection_lost(exc)

    def _wait(self) -> None:
        self._deadline = asyncio.get_running_loop().call_later(self.request_s, self._give_up)

    def _give_up(self) -> None:
        logger.info("a connection was closed: no complete request within %g s", self.request_s)
        self._transport.close()

    def _in_request(self) -> bool:
        """Whether the headers of a request have been read, and its response is not complete."""
        cycle: Any = getattr(self, "cycle", None)
        return cycle is not None and not cycle.response_complete
