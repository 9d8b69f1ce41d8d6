"""Plays the reference protocols of random variants through each integration, and measures the cost of an episode.

python -m tests.integrations.measure [NAME...] [--count N] [--seed S]

The model is the scripted one over HTTP, without its wrong calls. Each call is an iteration. The processor time is
that of the programs of the integration, the referee and the host, without the model.
"""

import argparse
import json
import random
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path

from evaluator.report.export import markdown_table
from evaluator.study.selection import SUITE, parse_scenes
from tests.harness.clients import scripted_model
from tests.integrations.playing import Stand, json_lines, standing
from tests.integrations.test_nemo_gym import PROGRAM as NEMO_GYM
from tests.integrations.test_openenv import PROGRAM as OPENENV
from tests.integrations.test_openenv import serving_openenv

Pairs = Sequence[tuple[int, int]]
BUDGET = 1000
"""Iterations: the scripted model makes one call in each, and reference protocols have hundreds of calls."""


def in_verifiers(stand: Stand, pairs: Pairs) -> list[float]:
    """Play in verifiers, two episodes at a time; returns the rewards."""
    words = ["--no-push", "--no-rich", "-m", "scripted", "--client.base-url", f"{stand.model}/v1", "-c", "2"]
    words += ["--env.taskset.pairs", str(_file(stand, pairs)), "--env.taskset.task.budget", str(BUDGET)]
    done = stand.run("vf-eval", "physment", *words, "--run.name", "all", "-o", stand.scratch / "out")
    assert done.returncode == 0, done.stderr[-2000:]
    traces = [
        trace for episode in json_lines(stand.scratch / "out" / "all" / "traces.jsonl") for trace in episode["traces"]
    ]
    return [trace["rewards"]["laboratory"]["score"] for trace in traces]


def in_openenv(stand: Stand, pairs: Pairs) -> list[float]:
    """Play in OpenEnv, in one session; returns the rewards."""
    with serving_openenv(stand) as url:
        named = [json.dumps({"scene": scene, "seed": seed}) for scene, seed in pairs]
        done = stand.run("python", OPENENV, url, stand.model, BUDGET, *named)
    return [json.loads(line)["rewards"][-1] for line in done.stdout.splitlines()]


def in_nemo_gym(stand: Stand, pairs: Pairs) -> list[float]:
    """Play in NeMo Gym, one row after another; returns the rewards."""
    words = ["-m", "physment_nemo_gym.dataset", "--pairs", _file(stand, pairs), "--budget", BUDGET]
    rows = stand.scratch / "rows.jsonl"
    rows.write_text(stand.run("python", *words).stdout, encoding="utf-8")
    done = stand.run("python", NEMO_GYM, stand.model, rows)
    return [json.loads(line)["reward"] for line in done.stdout.splitlines()]


INTEGRATIONS: dict[str, Callable[[Stand, Pairs], list[float]]] = {
    "verifiers": in_verifiers,
    "openenv": in_openenv,
    "nemo_gym": in_nemo_gym,
}


def _file(stand: Stand, pairs: Pairs) -> Path:
    file = stand.scratch / "pairs.jsonl"
    file.write_text("".join(json.dumps({"scene": scene, "seed": seed}) + "\n" for scene, seed in pairs))
    return file


def main(argv: Sequence[str]) -> int:
    """Measure and print a table; returns 0 if every reward is 1."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(INTEGRATIONS)}")
    parser.add_argument("--count", type=int, default=50, help="random pairs (default %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of their draw (default %(default)s)")
    args = parser.parse_args(argv)
    drawn = random.Random(args.seed)
    scenes = [files.scene_id for files in parse_scenes(SUITE, None)]
    pairs = [(drawn.choice(scenes), drawn.randrange(1, 10**6)) for _ in range(args.count)]
    scripted_model.WRONG_CALLS = 0  # scenes that limit calls allow no more than their protocol needs
    lines: list[tuple[str, ...]] = []
    right = True
    for name in args.names or INTEGRATIONS:
        before, clock = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
        with tempfile.TemporaryDirectory() as scratch, standing(name, Path(scratch)) as stand:
            rewards = INTEGRATIONS[name](stand, pairs)
            calls = sum(len(episode.turns) for episode in stand.folder.episodes().values())
        after, wall = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic() - clock
        spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        good = sum(reward == 1.0 for reward in rewards)
        right &= good == len(pairs)
        lines.append(
            (
                name,
                f"{good} of {len(pairs)}",
                f"{calls / len(pairs):.0f}",
                f"{len(pairs) / spent:.2f}",
                f"{1000 * spent / calls:.0f}",
                f"{wall:.0f}",
            )
        )
        print(lines[-1], flush=True)
    titles = ("integration", "rewards of 1", "calls each", "episodes/s per core", "processor ms per call", "wall s")
    print(markdown_table(titles, lines))
    return 0 if right else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
