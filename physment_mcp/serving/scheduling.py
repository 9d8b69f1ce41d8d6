"""In which order the requests of a host are served, so that those of one episode delay the others little.

All episodes share one event loop. A client with many requests at once would otherwise get as many shares of it, and a
long step, which runs in a thread, would compete with every request of others for the interpreter and the processors.
"""

import contextlib
import math
import time
from collections.abc import AsyncGenerator, Callable, Coroutine
from typing import Any

import anyio

PATIENCE_S = 0.1
"""Longest wall time that a request waits for the one before it [s]. On a busy host a brief request takes a third of it:
if the next did not wait for its end, many of an episode would be served side by side, each slower than before."""
_ALLOWED_S = 0.02
"""Wall time after which a step lets the next request of its episode in, because that may cancel it; and wall time that
an episode may step before it gives way to others [s]."""
_REGAINED = 0.1
"""Part of all wall time that an episode may step without giving way. Whoever breaks steps off thus gains nothing."""
_MOST_SPENT_S = 1.0
"""Most wall time of steps that is held against an episode [s]."""
_AT_ONCE = 8
"""Most requests of an episode that are served at the same time, because each of them waits for something."""
WAITS = 2.0
"""Longest wait of a long step for other episodes, as a multiple of the wall time that its last piece took. This bounds
what many busy episodes can do to it."""
_BRIEF_S = 0.002
"""Wall time of a piece of a long step while other episodes are served [s]: such a piece delays them little."""
_QUIET_S = 0.1
"""Wall time without requests of other episodes after which pieces are as long as usual [s]."""


class Scheduler:
    """The episodes of a host that are served now, apart from those whose request has taken long."""

    def __init__(self) -> None:
        """No episode is being served."""
        self._served: set[object] = set()
        self._quiet = anyio.Event()
        self._last: object = None
        """The episode of the latest request."""
        self._last_at = self._others_at = -math.inf
        self._entrance = anyio.Semaphore(1)

    async def enter(self) -> None:
        """Wait for the turn of a request that reaches no open episode.

        Such requests enter one after another, so that many of them delay an episode little: between two of them, the
        event loop serves whatever else is ready. None waits for the end of the one before, because opening an episode
        takes long.
        """
        async with self._entrance:
            pass

    def begin(self, episode: object) -> None:
        """A request of an episode is being served."""
        if not self._served:
            self._quiet = anyio.Event()
        self._served.add(episode)
        if episode is not self._last:
            self._last, self._others_at = episode, self._last_at
        self._last_at = time.monotonic()

    def end(self, episode: object) -> None:
        """It no longer is, or it has taken long."""
        self._served.discard(episode)
        if not self._served:
            self._quiet.set()

    def last_besides(self, episode: object) -> float:
        """When the latest request of another episode began, by the monotonic clock [s]."""
        return self._others_at if episode is self._last else self._last_at

    async def quiet(self) -> None:
        """Wait until no episode is being served."""
        while self._served:
            await self._quiet.wait()


class Turns:
    """The turns of the requests of one episode."""

    def __init__(
        self,
        scheduler: Scheduler | None = None,
        patience_s: float = PATIENCE_S,
        allowed_s: float = _ALLOWED_S,
        quiet_s: float = _QUIET_S,
    ) -> None:
        """Set up.

        Args:
            scheduler: Shared by the episodes of a host; None for an episode alone.
            patience_s: As `PATIENCE_S`.
            allowed_s: As `_ALLOWED_S`.
            quiet_s: As `_QUIET_S`.
        """
        self._scheduler = Scheduler() if scheduler is None else scheduler
        self._patience_s = patience_s
        self._allowed_s = allowed_s
        self._quiet_s = quiet_s
        # Fast: a request that need not wait costs no turn of the event loop, which one for every message would.
        self._places = anyio.Semaphore(_AT_ONCE, fast_acquire=True)
        self._turn = anyio.Semaphore(1, fast_acquire=True)
        self._holder: object = None
        """Stands for the request that has the turn; None if none has it."""
        self.exclusive = anyio.Lock(fast_acquire=True)
        """Held by whatever reads or changes the episode, because requests are also let in while another one runs."""
        self._spent_s = 0.0
        """Wall time of the pieces of its steps, less what it has regained since."""
        self._spent_at = time.monotonic()

    @contextlib.asynccontextmanager
    async def turn(self) -> AsyncGenerator[None]:
        """Wait for a turn. It begins when the request before ends, or when that one has taken long."""
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
        """Give the turn to the next request, if this one still has it."""
        if self._holder is request is not None:
            self._holder = None
            self._turn.release()

    def giving_way(self, at_most: float = WAITS) -> Callable[[], Coroutine[Any, Any, float | None]]:
        """What a call that works in pieces awaits before each: it lets others go first, if it takes long.

        It returns the wall time that the next piece may take [s]; None for the usual.

        Args:
            at_most: As `WAITS`.
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
        """Count a piece; returns the wall time that the episode has spent [s]."""
        kept = max(0.0, self._spent_s - _REGAINED * (now - self._spent_at))
        self._spent_s, self._spent_at = min(kept + piece_s, _MOST_SPENT_S), now
        return self._spent_s
