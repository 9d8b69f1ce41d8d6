"""Honest clients of a host: each plays its own episodes with typical calls at a typical pace, and times every call."""

import asyncio
import itertools
import random
import time
from dataclasses import dataclass, field

from tests.harness.load.wire import Connection, call, opened, request

_PACE_S = (0.2, 0.5)
"""Shortest and longest pause between two calls of a client [s]."""
_OBJECT = "object_1"


@dataclass
class Crowd:
    """A group of honest clients, with the durations of their calls."""

    port: int
    clients: int = 50
    calls_each: int | None = None
    """Calls after which a client closes its episode and opens another; None to keep the first episode."""
    pace_s: tuple[float, float] = _PACE_S
    took_s: list[float] = field(default_factory=list[float])
    """Duration of every call since the last `take`."""
    calls: int = 0
    episodes: int = 0
    failures: list[str] = field(default_factory=list[str])
    """Error messages of calls that should have succeeded."""

    async def play(self) -> None:
        """Play until cancelled."""
        async with asyncio.TaskGroup() as tasks:
            for number in range(self.clients):
                tasks.create_task(self._client(random.Random(number)))

    def take(self) -> list[float]:
        """Return and clear the durations of the calls since the last `take` [s]."""
        taken, self.took_s = self.took_s, []
        return taken

    async def _client(self, chance: random.Random) -> None:
        await asyncio.sleep(chance.uniform(0, self.pace_s[1]))
        connection = await Connection.dial(self.port)
        try:
            while True:
                await self._episode(connection, chance)
        finally:
            connection.close()

    async def _episode(self, connection: Connection, chance: random.Random) -> None:
        episode = await opened(self.port)
        self.episodes += 1
        for _ in itertools.count() if self.calls_each is None else range(self.calls_each):
            await asyncio.sleep(chance.uniform(*self.pace_s))
            began = time.perf_counter()
            reply = await connection.ask(_usual_call(episode["path"], chance))
            self.took_s.append(time.perf_counter() - began)
            self.calls += 1
            if reply.failed:
                self.failures.append(f"{reply.status} {reply.body[:200]!r}")
        # One of five leaves its episode to expire.
        if chance.random() < 0.8:
            await connection.ask(request("DELETE", f"/episodes/{episode['episode_id']}"))


def _usual_call(path: str, chance: random.Random) -> bytes:
    choice = chance.random()
    if choice < 0.5:
        return call(path, "step", duration=0.1)
    if choice < 0.8:
        return call(path, "get_position", object_id=_OBJECT)
    return call(path, "apply_force", object_id=_OBJECT, force_vector=[0.1, 0, 0])
