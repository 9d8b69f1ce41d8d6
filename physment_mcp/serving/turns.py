"""In which order the requests of one episode are served, so that it delays the requests of others little.

All episodes share one event loop. A client with many requests at once would otherwise get as many shares of it.
"""

import contextlib
from collections.abc import AsyncGenerator

import anyio

PATIENCE_S = 0.02
"""Longest wall time that a request waits for the one before it [s]. That one may be a long step, which runs in a
thread, and the request that waits may cancel it."""
_AT_ONCE = 8
"""Most requests of an episode that are served at the same time, because each of them waits for something."""


class Turns:
    """The turns of the requests of one episode."""

    def __init__(self, patience_s: float = PATIENCE_S) -> None:
        """Set up.

        Args:
            patience_s: As `PATIENCE_S`.
        """
        self._patience_s = patience_s
        # Fast: a request that need not wait costs no turn of the event loop, which one for every message would.
        self._places = anyio.Semaphore(_AT_ONCE, fast_acquire=True)
        self._turn = anyio.Semaphore(1, fast_acquire=True)

    @contextlib.asynccontextmanager
    async def turn(self) -> AsyncGenerator[None]:
        """Wait for a turn. It begins when the request before ends, or when that one has taken long."""
        async with self._places:
            alone = False
            with anyio.move_on_after(self._patience_s):
                await self._turn.acquire()
                alone = True
            try:
                yield
            finally:
                if alone:
                    self._turn.release()
