"""The front of a host with several workers: accepts connections and passes each to the worker of its first request.

It reads nothing: it looks at the first bytes and leaves them for the worker. An episode lives in one worker, whose
number its path holds. All other requests go to the workers in turn.
"""

import asyncio
import logging
import re
import socket
from collections.abc import Sequence
from itertools import cycle

from physment_mcp.serving.connections import REQUEST_S

logger = logging.getLogger(__name__)

_FIRST_LINE = re.compile(rb"[A-Z]+ (?:http://[^/ ]+)?/episodes/w(\d{1,4})\.")
_LOOK = 512
"""Bytes that are looked at."""
_ACCEPTED_AT_ONCE = 8
"""Connections that are accepted before others are looked at."""
_PAUSE_S = 1.0
"""Pause before connections are accepted again, if the system had no room for one [s]."""
_MOST_SILENT = 4096
"""Most connections that have not said anything yet."""


class Front:
    """Passes connections on."""

    def __init__(self, listener: socket.socket, workers: Sequence[socket.socket]) -> None:
        """Set up.

        Args:
            listener: Where connections come in.
            workers: For each worker, the socket that takes connections to it.
        """
        listener.setblocking(False)
        for worker in workers:
            worker.setblocking(False)
        self._listener = listener
        self._workers = workers
        self._next = cycle(range(len(workers)))
        self._silent: dict[socket.socket, asyncio.TimerHandle] = {}
        self._loop = asyncio.get_running_loop()

    async def run(self) -> None:
        """Accept connections until this is cancelled; then those that have said nothing are closed."""
        try:
            while True:
                for _ in range(_ACCEPTED_AT_ONCE):
                    await self._take_one()
                await asyncio.sleep(0)
        finally:
            for connection in list(self._silent):
                self._let_go(connection)
                connection.close()

    async def _take_one(self) -> None:
        try:
            connection, _ = await self._loop.sock_accept(self._listener)
        except OSError as error:
            # As when too many files are open. The connection waits, so asking again at once would only spin.
            logger.warning("no connection is accepted for %g s: %s", _PAUSE_S, error.strerror)
            await asyncio.sleep(_PAUSE_S)
            return
        if len(self._silent) >= _MOST_SILENT:
            connection.close()
            return
        connection.setblocking(False)
        self._silent[connection] = self._loop.call_later(REQUEST_S, self._give_up, connection)
        self._loop.add_reader(connection, self._pass_on, connection)

    def _let_go(self, connection: socket.socket) -> None:
        self._silent.pop(connection).cancel()
        self._loop.remove_reader(connection)

    def _give_up(self, connection: socket.socket) -> None:
        logger.info("a connection was closed: nothing came within %g s", REQUEST_S)
        self._let_go(connection)
        connection.close()

    def _pass_on(self, connection: socket.socket) -> None:
        try:
            first = connection.recv(_LOOK, socket.MSG_PEEK)
        except BlockingIOError:
            return
        except OSError:
            first = b""
        self._let_go(connection)
        with connection:
            if not first:
                return
            found = _FIRST_LINE.match(first)
            number = int(found[1]) if found else -1
            if not 0 <= number < len(self._workers):
                number = next(self._next)
            try:
                socket.send_fds(self._workers[number], [b"\n"], [connection.fileno()])
            except OSError as error:
                logger.warning("worker %d takes no connection: %s", number + 1, error.strerror)
