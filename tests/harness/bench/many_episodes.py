"""Many concurrent conversations on one machine: wall time relative to the ideal, and processor time per turn.

The agent simulates a model: it waits for a fixed time, then calls two tools, and answers in its last turn. The ideal is
the total waiting time of one conversation. Two times are compared with it: from the opening of the first conversation
to the end of the last, and that of the whole command `physment-eval run`, with start-up, grades and report.
python -m tests.harness.bench.many_episodes [--episodes N] [--turns N] [--thinking S] [--workers N]
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from pathlib import Path

import anyio

from evaluator.episode.player import Briefing, Feedback, Reply
from evaluator.records.episode import EpisodeKey, Outcome, ToolCall
from evaluator.store.run_folder import RunFolder

ROOT = Path(__file__).parents[3]
_TURNS, _THINKING = "BENCH_TURNS", "BENCH_THINKING_S"
"""Environment variables that configure the agent; worker processes load it by its class name."""


@dataclass(frozen=True)
class Thinker:
    """An agent that waits for `thinking_s` before each turn."""

    turns: int = field(default_factory=lambda: int(os.environ[_TURNS]))
    thinking_s: float = field(default_factory=lambda: float(os.environ[_THINKING]))
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
        await anyio.sleep(self.agent.thinking_s)
        self.taken += 1
        if self.taken == self.agent.turns:
            return Reply("Enough.", (ToolCall(tool="answer", arguments={"answer": 7.8}),))
        step = ToolCall(tool="step", arguments={"duration": 0.1})
        return Reply("On.", (step, ToolCall(tool="get_velocity", arguments={"object_id": "object_1"})))


def command(episodes: int, turns: int, workers: int, out: Path) -> list[str]:
    """The run that is timed."""
    agent = f"{__spec__.name}:Thinker" if __spec__ else "tests.harness.bench.many_episodes:Thinker"
    words = [sys.executable, "-m", "evaluator", "run", "--server", "host", "--agent", agent, "--scenes", "7"]
    words += ["--seeds", f"0-{episodes - 1}", "--budget", str(turns), "--concurrency", str(episodes)]
    return [*words, "--workers", str(workers), "--out", str(out)]


def main() -> None:
    """Play the episodes and print the times."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--episodes", type=int, default=500, help="conversations, all at the same time (default: 500)")
    parser.add_argument("--turns", type=int, default=20, choices=(5, 10, 15, 20), help="turns of each (default: 20)")
    parser.add_argument("--thinking", type=float, default=2.0, help="wall time before each turn [s] (default: 2)")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="processes that play (default: processors)")
    options = parser.parse_args()
    environment = {**os.environ, _TURNS: str(options.turns), _THINKING: str(options.thinking)}
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(scratch) / "run"
        words, clock = command(options.episodes, options.turns, options.workers, out), time.perf_counter()
        done = subprocess.run(words, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
        wall = time.perf_counter() - clock
        if done.returncode not in (0, 1):  # 1: wrong answers, as here
            sys.exit(done.stderr)
        episodes = list(RunFolder(out).episodes().values())
        answered = sum(episode.outcome is Outcome.ANSWERED for episode in episodes)
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    began = [(datetime.fromisoformat(episode.started_at), episode.duration_s) for episode in episodes]
    ended = max(start + timedelta(seconds=duration_s) for start, duration_s in began)
    talking = (ended - min(began)[0]).total_seconds()
    ideal, all_turns = options.turns * options.thinking, options.episodes * options.turns
    print(
        f"{answered} of {options.episodes} episodes answered by {options.workers} processes, {options.turns} turns each"
    )
    print(f"conversations {talking:.1f} s, ideal {ideal:.1f} s: {talking / ideal:.3f} ×")
    print(f"whole command {wall:.1f} s: {wall / ideal:.3f} ×")
    print(f"processor time per turn, all processes: {(used.ru_utime + used.ru_stime) / all_turns * 1e3:.2f} ms")


if __name__ == "__main__":
    main()
