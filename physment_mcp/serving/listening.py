"""Runs the episode server with uvicorn: the listening socket, the configuration, and process-wide settings.

Settings that defend against an attack state its name, as `python -m tests.harness.load.hostile` uses it.
"""

import ctypes
import gc
import json
import socket
import sys

import uvicorn

from physment_mcp.serving.episode_server import EpisodeServer
from physment_mcp.serving.http_guard import Connections, bounded_protocol

_KEEP_ALIVE_S = 60
"""Keep-alive timeout of idle connections [s]. Longer than that of clients (5 s), so the client closes first."""
_CONNECTIONS_EACH = 8
"""Largest number of connections per episode (attack `half-open connections`); a client uses two or three."""
_MORE_CONNECTIONS = 100
"""Allowed connections in addition to those of the episodes."""
_ACCEPTED_AT_ONCE = 8
"""Connections accepted in one event loop iteration (attacks `200 requests at once`, `200 wrong URLs at once`)."""
_BACKLOG = 1024
"""Length of the queue of connections that the system has not handed over yet."""

_GC_THRESHOLDS = (2_000, 5, 50)
"""GC thresholds: generation 0 after 2,000 allocations (1 to 2 ms), generation 1 after 5 collections of generation 0
(5 ms), generation 2 after 50 of generation 1 (attacks `slow readers`, `steps of 60 s broken off`)."""
_M_MMAP_THRESHOLD, _LARGE = -3, 128 * 1024
"""The parameter of glibc's `mallopt`, and the size of a block from which it is allocated by mmap [bytes]."""


def listen(address: str, port: int) -> socket.socket:
    """Listen on an address.

    Raises:
        OSError: The system does not allow it.
    """
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    listener = socket.create_server((address.strip("[]"), port), family=family, backlog=_BACKLOG)
    # Accepted connections inherit this. Nagle's algorithm would delay small packets: 40 ms a call.
    listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return listener


def announce(listener: socket.socket) -> None:
    """Print the address with the chosen port as one line of JSON."""
    bound, chosen = listener.getsockname()[:2]
    shown = f"[{bound}]" if ":" in bound else bound
    print(json.dumps({"listening": f"http://{shown}:{chosen}"}), flush=True)  # noqa: T201 - the command's output


def serve(host: EpisodeServer, address: str, port: int) -> None:
    """Serve until interrupted. Prints the address with the chosen port as one line of JSON.

    Raises:
        OSError: The system does not allow listening on this address.
    """
    listener = listen(address, port)
    announce(listener)
    _run(DeepBacklogServer(_config(host)), [listener])


def _run(server: uvicorn.Server, sockets: list[socket.socket]) -> None:
    """Serve until interrupted, with the garbage collector set for short pauses.

    A collection stops all episodes. `gc.freeze` excludes the objects of the imported modules, because scanning them
    would take 30 to 70 ms.
    """
    gc.collect()
    gc.freeze()
    gc.set_threshold(*_GC_THRESHOLDS)
    _give_memory_back()
    server.run(sockets)


def _give_memory_back() -> None:
    """Let glibc return the memory of a closed episode to the system at once (attack `episodes opened and closed`).

    The data of an episode are blocks of some hundred kilobytes. By default glibc raises its mmap threshold and
    allocates such blocks from its heap, which fragments: it grows by 3 to 20 kB for each closed episode.
    """
    if sys.platform == "linux":
        mallopt = getattr(ctypes.CDLL(None), "mallopt", None)  # other C libraries than glibc have none
        if mallopt is not None:
            mallopt(_M_MMAP_THRESHOLD, _LARGE)


def _config(host: EpisodeServer) -> uvicorn.Config:
    most = _CONNECTIONS_EACH * host.max_episodes + _MORE_CONNECTIONS
    return uvicorn.Config(
        host.app(),
        http=bounded_protocol(Connections(most, most * 3 // 4)),
        backlog=_ACCEPTED_AT_ONCE,
        log_config=None,  # uvicorn then logs through the root logger, as all other modules do
        log_level="warning",
        timeout_graceful_shutdown=2,
        timeout_keep_alive=_KEEP_ALIVE_S,
    )


class DeepBacklogServer(uvicorn.Server):
    """A uvicorn server with separate settings for the socket's backlog and for connections accepted at once."""

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start to listen, and lengthen the backlog."""
        await super().startup(sockets)
        for listener in sockets or ():
            listener.listen(_BACKLOG)
