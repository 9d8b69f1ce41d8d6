"""Plays the reference protocols of random variants through each integration, and measures the cost of an episode.

python -m tests.integrations.measure [NAME...] [--scenes S] [--count N] [--seed S] [--parallel N]

The model is the scripted one over HTTP, without its wrong calls. Each call is an iteration. The processor time is that
of the programs of the integration, the referee and the host, without the model. One episode is played first: it gives
the cost of the start, which is subtracted from that of all other episodes. The memory is that of the programs of the
integration alone, shared pages divided among their users (PSS).
"""

import argparse
import contextlib
import functools
import json
import os
import random
import resource
import sys
import tempfile
import threading
from collections.abc import Callable, Generator, Sequence
from pathlib import Path
from typing import NamedTuple

from evaluator.report.export import markdown_table
from evaluator.study.selection import SUITE, parse_scenes
from tests.harness.clients import scripted_model
from tests.integrations.playing import Stand, json_lines, standing
from tests.integrations.test_nemo_gym import PROGRAM as NEMO_GYM
from tests.integrations.test_openenv import PROGRAM as OPENENV
from tests.integrations.test_openenv import serving_openenv

Pairs = Sequence[tuple[int, int]]
Played = list[tuple[float, int]]
"""Reward and number of calls of each episode."""
BUDGET = 1000
"""Iterations: the scripted model makes one call in each, and reference protocols have hundreds of calls."""
TRL = Path(__file__).parent / "programs" / "trl_agent.py"
ALONE = "-in-process"
_SAMPLE_S = 1.0
_TITLES = (
    "integration", "rewards of 1", "calls each", "episodes/s per core", "processor ms per call", "start s",
    "memory MB", "load",
)  # fmt: skip


class Cost(NamedTuple):
    """What episodes cost."""

    played: Played
    busy_s: float
    """Processor time, with the start [s]."""
    memory_mb: float

    @property
    def calls(self) -> int:
        """All calls."""
        return sum(calls for _, calls in self.played)


class Peak:
    """The largest memory of the programs that have the address of a referee in their environment."""

    def __init__(self, referee: str) -> None:
        """Sample nothing yet."""
        self._mark = f"PHYSMENT_REFEREE_URL={referee}\0".encode()
        self.mb = 0.0

    def sample(self) -> None:
        """Measure the memory that the programs use now."""
        found = 0
        for process in Path("/proc").glob("[0-9]*"):
            with contextlib.suppress(OSError):  # it ended meanwhile, or belongs to another user
                if self._mark in (process / "environ").read_bytes():
                    lines = (process / "smaps_rollup").read_text(encoding="ascii").splitlines()
                    found += next(int(line.split()[1]) for line in lines if line.startswith("Pss:"))
        self.mb = max(self.mb, found / 1000)


@contextlib.contextmanager
def sampled(referee: str) -> Generator[Peak]:
    """Sample the memory of the programs that use a referee, in a thread."""
    peak, ended = Peak(referee), threading.Event()

    def sample() -> None:
        while not ended.wait(_SAMPLE_S):
            peak.sample()

    thread = threading.Thread(target=sample)
    thread.start()
    try:
        yield peak
    finally:
        ended.set()
        thread.join()


def measured(name: str, pairs: Pairs) -> Cost:
    """Start an integration and play all pairs in it."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with (
        tempfile.TemporaryDirectory() as scratch,
        # Without this option, the proofs of the seeds would be measured, too.
        standing(name.removesuffix(ALONE), Path(scratch), "--unproved") as stand,
        sampled(stand.referee) as peak,
    ):
        played = INTEGRATIONS[name](stand, pairs)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert len(played) == len(pairs), f"{name}: {len(played)} of {len(pairs)} episodes ended"
    return Cost(played, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime, peak.mb)


def row(name: str, first: Cost, others: Cost, load: float) -> tuple[str, ...]:
    """Describe what an episode of an integration costs without the start."""
    spent, played = others.busy_s - first.busy_s, len(others.played)
    return (
        name,
        f"{sum(reward == 1.0 for reward, _ in others.played)} of {played}",
        f"{others.calls / played:.0f}",
        f"{(played - 1) / spent:.2f}",
        f"{1000 * spent / (others.calls - first.calls):.1f}",
        f"{first.busy_s:.1f}",
        f"{others.memory_mb:.0f}",
        f"{load:.1f}",
    )


def in_verifiers(stand: Stand, pairs: Pairs, parallel: int = 2) -> Played:
    """Play in verifiers, several episodes at a time; returns the episodes."""
    words = ["--no-push", "--no-rich", "-m", "scripted", "--client.base-url", f"{stand.model}/v1", "-c", str(parallel)]
    words += ["--env.taskset.pairs", str(_file(stand, pairs)), "--env.taskset.task.budget", str(BUDGET)]
    done = stand.run("vf-eval", "physment", *words, "--run.name", "all", "-o", stand.scratch / "out")
    assert done.returncode == 0, done.stderr[-2000:]
    traces = [
        trace for episode in json_lines(stand.scratch / "out" / "all" / "traces.jsonl") for trace in episode["traces"]
    ]
    return [(trace["rewards"]["laboratory"]["score"], int(trace["metrics"]["calls"])) for trace in traces]


def in_openenv(stand: Stand, pairs: Pairs) -> Played:
    """Play in OpenEnv, in one session; returns the episodes."""
    with serving_openenv(stand) as url:
        done = stand.run("python", OPENENV, url, stand.model, BUDGET, *_named(pairs))
    rewards = [json.loads(line)["rewards"] for line in done.stdout.splitlines()]
    return [(found[-1], len(found) - 1) for found in rewards]


def in_trl(stand: Stand, pairs: Pairs, backend: str = "referee") -> Played:
    """Play on one environment for TRL; returns the episodes."""
    done = stand.run("python", TRL, backend, stand.model, BUDGET, *_named(pairs))
    return _printed(done.stdout)


def in_trl_alone(stand: Stand, pairs: Pairs) -> Played:
    """Play in the process of the environment for TRL; returns the episodes."""
    return in_trl(stand, pairs, "process")


def in_nemo_gym(stand: Stand, pairs: Pairs) -> Played:
    """Play in NeMo Gym, one row after another; returns the episodes."""
    words = ["-m", "physment_nemo_gym.dataset", "--pairs", _file(stand, pairs), "--budget", BUDGET]
    rows = stand.scratch / "rows.jsonl"
    rows.write_text(stand.run("python", *words).stdout, encoding="utf-8")
    done = stand.run("python", NEMO_GYM, stand.model, rows)
    return _printed(done.stdout)


INTEGRATIONS: dict[str, Callable[[Stand, Pairs], Played]] = {
    "verifiers": in_verifiers,
    "openenv": in_openenv,
    "nemo_gym": in_nemo_gym,
    "trl": in_trl,
    f"trl{ALONE}": in_trl_alone,
}


def _printed(lines: str) -> Played:
    return [(found["reward"], found["calls"]) for found in map(json.loads, lines.splitlines())]


def _named(pairs: Pairs) -> list[str]:
    return [json.dumps({"scene": scene, "seed": seed}) for scene, seed in pairs]


def _file(stand: Stand, pairs: Pairs) -> Path:
    file = stand.scratch / "pairs.jsonl"
    file.write_text("".join(f"{line}\n" for line in _named(pairs)))
    return file


def main(argv: Sequence[str]) -> int:
    """Measure and print a table; returns 0 if every reward is 1."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(INTEGRATIONS)}")
    parser.add_argument("--scenes", default=SUITE, help="as for physment-eval (default: the suite)")
    parser.add_argument("--count", type=int, default=50, help="random pairs (default %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of their draw (default %(default)s)")
    parser.add_argument("--parallel", type=int, default=2, help="episodes at a time in verifiers (default %(default)s)")
    args = parser.parse_args(argv)
    INTEGRATIONS["verifiers"] = functools.partial(in_verifiers, parallel=args.parallel)
    drawn = random.Random(args.seed)
    scenes = [files.scene_id for files in parse_scenes(args.scenes, None)]
    pairs = [(drawn.choice(scenes), drawn.randrange(1, 10**6)) for _ in range(args.count)]
    scripted_model.WRONG_CALLS = 0  # scenes that limit calls allow no more than their protocol needs
    lines: list[tuple[str, ...]] = []
    right = True
    for name in args.names or INTEGRATIONS:
        first, others = measured(name, pairs[:1]), measured(name, pairs)
        right &= all(reward == 1.0 for reward, _ in others.played)
        lines.append(row(name, first, others, os.getloadavg()[0]))
        print(lines[-1], flush=True)
    print(markdown_table(_TITLES, lines))
    return 0 if right else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
