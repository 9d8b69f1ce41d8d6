"""Processor time per turn of many conversations on a local host, over passed sockets and over HTTP.

`rows` yields the rows that `make bench` prints. It measures processor time because wall time depends on the other
processes of the machine.
Run with: python -m tests.harness.bench.transports [EPISODES [TURNS [ROUNDS]]]
"""

import resource
import sys
import tempfile
import time
from collections.abc import AsyncGenerator
from dataclasses import replace
from pathlib import Path

import anyio

from evaluator.commands.program import make_room
from evaluator.episode.hosts import LocalHost
from evaluator.episode.loop import AgentParticipant
from evaluator.episode.toolbox import Toolboxes
from evaluator.records.episode import Versions
from evaluator.records.run import Plan
from evaluator.store.run_folder import RunFolder
from evaluator.study.runner import LocalPlay, Runner
from tests.harness.bench.many_episodes import Thinker
from tests.harness.bench.measuring import Row, row_of

AIM = 0.6


async def turn(episodes: int, turns: int, *, sockets: bool) -> tuple[float, float]:
    """Processor time per turn of the evaluator and of its host [s]."""
    agent = Thinker(turns, 0.0)
    plan = Plan(scenes=(7,), agents=(agent.name,), seeds=tuple(range(episodes)), budgets=(turns,))
    versions = Versions(physment="0", protocol="0", pack="0")
    before = await _start()
    before += _of_children()
    with tempfile.TemporaryDirectory() as scratch:
        async with LocalHost() as host:
            laboratory = host if sockets else replace(host, control=None, toolboxes=Toolboxes())
            async with laboratory.open(7, 0) as client:
                await laboratory.toolboxes.of(client)
            busy = time.process_time()
            play = LocalPlay(laboratory, {agent.name: AgentParticipant(agent)}, lambda _scene: versions)
            folder = RunFolder(Path(scratch))
            await Runner(play=play, folder=folder, concurrency=episodes).run(plan.matrix())
            busy = time.process_time() - busy
    return busy / (episodes * turns), (_of_children() - before) / (episodes * turns)


async def _start() -> float:
    """Return the processor time of a host without episodes [s]: it starts and lists its tools once."""
    before = _of_children()
    async with LocalHost() as host, host.open(7, 0) as client:
        await host.toolboxes.of(client)
    return _of_children() - before


def _of_children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


async def rows(episodes: int = 40, turns: int = 20, rounds: int = 3) -> AsyncGenerator[Row]:
    """Compare turns over sockets with turns over HTTP, alternately; the start of the host is not included."""
    pairs = [
        (await turn(episodes, turns, sockets=True), await turn(episodes, turns, sockets=False)) for _ in range(rounds)
    ]
    for side, what in enumerate(("evaluator", "host")):
        times = [(ours[side], theirs[side]) for ours, theirs in pairs]
        yield row_of(f"turn of two calls, {what}: sockets against HTTP", times, AIM)


async def main() -> None:
    """Print the rows."""
    words = [int(word) for word in sys.argv[1:]]
    async for row in rows(*words):
        print(f"{row.what}: {row.ours_s * 1e3:.2f} ms, {row.theirs_s * 1e3:.2f} ms, {row.ratio:.2f} (aim {row.aim:g})")


if __name__ == "__main__":
    make_room()  # as `physment-eval` does
    anyio.run(main)
