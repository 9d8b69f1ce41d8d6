"""In which order the requests of a host are served, so that those of one episode delay the others little.

All episodes share one event loop. A client with many requests at once would otherwise get as many shares of it, and a
long step, which runs in a thread, would compete with every request of others for the interpreter and the processors.
"""

import contextlib
import time
from collections.abc import AsyncGenerator, Callable, Coroutine
from typing import Any

import anyio

PATIENCE_S = 0.02
"""Longest wall time that a request waits for the one before it [s]. That one may be a long step, which runs in a
thread, and the request that waits may cancel it. A step that has taken so long gives way to other episodes."""
_AT_ONCE = 8
"""Most requests of an episode that are served at the same time, because each of them waits for something."""
WAITS = 2.0
"""Longest wait of a long step for other episodes, as a multiple of the wall time that its last piece took. This bounds
what many busy episodes can do to it."""
_BRIEF_S = 0.005
"""Wall time of a piece of a long step while other episodes are served [s]: such a piece delays them little."""


class Traffic:
    """The episodes of a host that are served now, apart from those whose request has taken long."""

    def __init__(self) -> None:
        """No episode is being served."""
        self.begun = 0
        """Requests so far."""
        self._served: set[object] = set()
        self._quiet = anyio.Event()

    def begin(self, episode: object) -> None:
        """A request of an episode is being served."""
        if not self._served:
            self._quiet = anyio.Event()
        self._served.add(episode)
        self.begun += 1

    def end(self, episode: object) -> None:
        """It no longer is, or it has taken long."""
        self._served.discard(episode)
        if not self._served:
            self._quiet.set()

    async def quiet(self) -> None:
        """Wait until no episode is being served."""
        while self._served:
            await self._quiet.wait()


class Turns:
    """The turns of the requests of one episode."""

    def __init__(self, traffic: Traffic | None = None, patience_s: float = PATIENCE_S) -> None:
        """Set up.

        Args:
            traffic: Shared by the episodes of a host; None for an episode alone.
            patience_s: As `PATIENCE_S`.
        """
        self._traffic = Traffic() if traffic is None else traffic
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
            if alone:
                self._traffic.begin(self)
            try:
                yield
            finally:
                if alone:
                    self._traffic.end(self)
                    self._turn.release()

    def giving_way(self, at_most: float = WAITS) -> Callable[[], Coroutine[Any, Any, float | None]]:
        """What a call that works in pieces awaits before each: if the call takes long, it waits for other episodes.

        It returns the wall time that the next piece may take [s]; None for the usual.

        Args:
            at_most: As `WAITS`.
        """
        began_at = resumed_at = time.monotonic()
        begun = self._traffic.begun

        async def give_way() -> float | None:
            nonlocal resumed_at, begun
            now = time.monotonic()
            if now - began_at < self._patience_s:
                resumed_at = now
                return None
            self._traffic.end(self)
            with anyio.move_on_after(at_most * (now - resumed_at)) as waiting:
                await self._traffic.quiet()
            alone = begun == self._traffic.begun and not waiting.cancelled_caught
            resumed_at, begun = time.monotonic(), self._traffic.begun
            return None if alone else _BRIEF_S

        return give_way
