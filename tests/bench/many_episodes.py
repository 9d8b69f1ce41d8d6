"""Many concurrent conversations on one host: wall time relative to the ideal, and processor time per turn.

The agent simulates a model: it waits for a fixed time, then calls two tools, and answers in its last turn. The ideal is
the sum of the waiting times. Run with: python tests/bench/many_episodes.py [EPISODES [TURNS [LATENCY_S]]]
"""

import resource
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import anyio

from evaluator.commands.process import make_room
from evaluator.episode.connect import LocalHost
from evaluator.episode.contender import AgentContender
from evaluator.episode.player import Briefing, Feedback, Reply
from evaluator.records import EpisodeKey, Outcome, ToolCall, Versions
from evaluator.run_record import Plan
from evaluator.store import RunFolder
from evaluator.study.attempts import LocalPlay
from evaluator.study.runner import Runner


@dataclass(frozen=True)
class Thinker:
    """An agent that waits for `latency_s` before each turn."""

    turns: int
    latency_s: float
    name: str = "thinker"

    def player(self, key: EpisodeKey, briefing: Briefing) -> "_Thinking":
        """A new player."""
        del key, briefing
        return _Thinking(self)


@dataclass
class _Thinking:
    agent: Thinker
    taken: int = 0

    async def act(self, feedback: Feedback | None) -> Reply:
        """Wait, then call."""
        del feedback
        await anyio.sleep(self.agent.latency_s)
        self.taken += 1
        if self.taken == self.agent.turns:
            return Reply("Enough.", (ToolCall(tool="answer", arguments={"answer": 7.8}),))
        step = ToolCall(tool="step", arguments={"duration": 0.1})
        return Reply("On.", (step, ToolCall(tool="get_velocity", arguments={"object_id": "object_1"})))


async def run(episodes: int, turns: int, latency_s: float) -> None:
    """Play the episodes and print the times."""
    agent = Thinker(turns, latency_s)
    plan = Plan(scenes=(7,), agents=(agent.name,), seeds=tuple(range(episodes)), budgets=(turns,))
    versions = Versions(physment="0", protocol="0", pack="0")
    with tempfile.TemporaryDirectory() as scratch:
        folder = RunFolder(Path(scratch))
        async with LocalHost() as laboratory:
            clock, busy = time.perf_counter(), time.process_time()
            play = LocalPlay(laboratory, {agent.name: AgentContender(agent)}, lambda _scene: versions)
            await Runner(play=play, folder=folder, concurrency=episodes).run(plan.matrix())
            wall, busy = time.perf_counter() - clock, time.process_time() - busy
        hosted = resource.getrusage(resource.RUSAGE_CHILDREN)
        answered = sum(episode.outcome is Outcome.ANSWERED for episode in folder.episodes().values())
    ideal, all_turns = turns * latency_s, episodes * turns
    print(f"{answered} of {episodes} episodes answered, {turns} turns each, {latency_s:g} s of thinking per turn")
    print(f"wall time {wall:.1f} s, ideal {ideal:.1f} s: {wall / ideal:.3f} ×")
    print(f"processor time per turn: evaluator {busy / all_turns * 1e3:.2f} ms,", end=" ")
    print(f"host {(hosted.ru_utime + hosted.ru_stime) / all_turns * 1e3:.2f} ms")


if __name__ == "__main__":
    make_room()  # as `physment-eval` does
    words = dict(enumerate(sys.argv[1:]))
    anyio.run(run, int(words.get(0, "500")), int(words.get(1, "20")), float(words.get(2, "2")))
