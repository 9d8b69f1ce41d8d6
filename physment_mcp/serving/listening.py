"""A host on its port: the listening socket, the configuration of uvicorn, and the settings of the process."""

import ctypes
import gc
import json
import socket
import sys

import uvicorn

from physment_mcp.serving.host import Host
from physment_mcp.serving.http_guard import Connections, bounded_protocol

_KEEP_ALIVE_S = 60
"""How long an idle connection is kept [s]: longer than by clients (5 s), so that none is closed just as it is used."""
_CONNECTIONS_EACH = 8
"""Open connections for each episode that may be open: a client that plays one uses two or three."""
_MORE_CONNECTIONS = 100
"""Open connections besides these."""
_ACCEPTED_AT_ONCE = 8
"""Connections that are accepted before requests on open ones are looked at again."""
_WAITING = 1024
"""Connections that may wait to be accepted."""

_NEW_OBJECTS = (2_000, 5, 50)
"""Thresholds of the garbage collector: generation 0 after 2,000 allocations (1 to 2 ms), generation 1 after 5
collections of generation 0 (5 ms), generation 2 after 50 of generation 1, if its objects have become more by a
quarter."""
_M_MMAP_THRESHOLD, _LARGE = -3, 128 * 1024
"""The parameter of glibc's `mallopt`, and the size from which memory is a mapping of its own [bytes]."""


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
