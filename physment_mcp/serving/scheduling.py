"""Fair scheduling: requests of one episode must not delay the other episodes of the server much.

All episodes share one event loop. Without scheduling, a client that sends many requests at once gets as many shares of
its time, and a long step, which runs in a thread, competes with every other request for the GIL and the processors.
"""

import contextlib
import math
import time
from collections.abc import AsyncGenerator, Callable, Coroutine
from typing import Any

import anyio

PATIENCE_S = 0.1
"""Longest time that a request waits for the previous one of its episode [s]. On a busy server a short request takes a
third of this time. Without the wait, many requests of an episode would run concurrently, each slower than before."""
_ALLOWED_S = 0.02
"""Time after which a step admits the next request of its episode, which may be its cancellation; also the time that an
episode may step before it yields to others [s]."""
_REGAINED = 0.1
"""Fraction of elapsed time by which the used step time decreases again. Cancelling steps does not reset it."""
_MOST_SPENT_S = 1.0
"""Largest used step time that is recorded for an episode [s]."""
_AT_ONCE = 8
"""Largest number of concurrent requests of an episode; all but one of them wait."""
WAITS = 2.0
"""Longest wait of a long step for other episodes, as a multiple of the time of its last piece. It bounds the slowdown
by many busy episodes."""
_BRIEF_S = 0.002
"""Duration of one piece of a long step while other episodes are served [s]."""
_QUIET_S = 0.1
"""Time without requests of other episodes after which pieces have their usual duration [s]."""


class Scheduler:
    """Records which episodes of a server have a request that is being served; long steps are not counted."""

    def __init__(self) -> None:
        """Create a scheduler without requests."""
        self._served: set[object] = set()
        self._quiet = anyio.Event()
        self._last: object = None
        """The episode of the latest request."""
        self._last_at = self._others_at = -math.inf
        self._entrance = anyio.Semaphore(1)

    async def enter(self) -> None:
        """Admit a request that reaches no open episode.

        Such requests are admitted one per iteration of the event loop, so many of them delay the episodes little. They
        do not wait for each other to end, because opening an episode takes long.
        """
        async with self._entrance:
            pass

    def begin(self, episode: object) -> None:
        """Record that a request of an episode is being served."""
        if not self._served:
            self._quiet = anyio.Event()
        self._served.add(episode)
        if episode is not self._last:
            self._last, self._others_at = episode, self._last_at
        self._last_at = time.monotonic()

    def end(self, episode: object) -> None:
        """Record that a request has ended, or has become a long step."""
        self._served.discard(episode)
        if not self._served:
            self._quiet.set()

    def last_besides(self, episode: object) -> float:
        """Return the start of the latest request of any other episode, on the monotonic clock [s]."""
        return self._others_at if episode is self._last else self._last_at

    async def quiet(self) -> None:
        """Wait until no episode is being served."""
        while self._served:
            await self._quiet.wait()


class Turns:
    """Serves the requests of one episode in turn."""

    def __init__(
        self,
        scheduler: Scheduler | None = None,
        patience_s: float = PATIENCE_S,
        allowed_s: float = _ALLOWED_S,
        quiet_s: float = _QUIET_S,
    ) -> None:
        """Create the turns in which the requests of one episode are served.

        Args:
            scheduler: Scheduler that the episodes of a host share; None for a single episode.
            patience_s: See `PATIENCE_S`.
            allowed_s: See `_ALLOWED_S`.
            quiet_s: See `_QUIET_S`.
        """
        self._scheduler = Scheduler() if scheduler is None else scheduler
        self._patience_s = patience_s
        self._allowed_s = allowed_s
        self._quiet_s = quiet_s
        # `fast_acquire`: a request that need not wait costs no iteration of the event loop.
        self._places = anyio.Semaphore(_AT_ONCE, fast_acquire=True)
        self._turn = anyio.Semaphore(1, fast_acquire=True)
        self._holder: object = None
        """Identifies the request that has the turn; None if none has it."""
        self.exclusive = anyio.Lock(fast_acquire=True)
        """Lock on the episode's state, because a request may be admitted while another one still runs."""
        self._spent_s = 0.0
        """Used step time, reduced as described at `_REGAINED` [s]."""
        self._spent_at = time.monotonic()

    @contextlib.asynccontextmanager
    async def turn(self) -> AsyncGenerator[None]:
        """Wait for a turn. It begins when the previous request ends or exceeds its time."""
        async with self._places:
            request = object()
            with anyio.move_on_after(self._patience_s):
                await self._turn.acquire()
                self._holder = request
            alone = self._holder is request
            if alone:
                self._scheduler.begin(self)
            try:
                yield
            finally:
                if alone:
                    self._scheduler.end(self)
                self._pass_on(request)

    def _pass_on(self, request: object) -> None:
        """Release the turn, if this request still has it."""
        if self._holder is request is not None:
            self._holder = None
            self._turn.release()

    def giving_way(self, at_most: float = WAITS) -> Callable[[], Coroutine[Any, Any, float | None]]:
        """Return a coroutine function that a long call awaits before each piece of work, to yield to other episodes.

        It returns the time that the next piece may take [s]; None for the usual time.

        Args:
            at_most: See `WAITS`.
        """
        began_at = resumed_at = time.monotonic()
        request = self._holder

        async def give_way() -> float | None:
            nonlocal resumed_at
            now = time.monotonic()
            piece_s = now - resumed_at
            if now - began_at >= self._allowed_s:
                self._pass_on(request)
            in_vain = False
            if self._spend(piece_s, now) >= self._allowed_s:
                self._scheduler.end(self)
                with anyio.move_on_after(at_most * piece_s) as waiting:
                    await self._scheduler.quiet()
                in_vain = waiting.cancelled_caught
            resumed_at = time.monotonic()
            alone = resumed_at - self._scheduler.last_besides(self) > self._quiet_s and not in_vain
            return None if alone else _BRIEF_S

        return give_way

    def _spend(self, piece_s: float, now: float) -> float:
        """Add the duration of a piece of work; returns the used step time [s]."""
        kept = max(0.0, self._spent_s - _REGAINED * (now - self._spent_at))
        self._spent_s, self._spent_at = min(kept + piece_s, _MOST_SPENT_S), now
        return self._spent_s
