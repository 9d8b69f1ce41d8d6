"""Checks that every scene ranks the synthetic takers by ability: plays them, and lists the scenes that do not.

    python -m tests.harness.takers                                   30 takers × 105 scenes × 3 seeds: many hours
    python -m tests.harness.takers --scenes 7-20 --seeds 0-1 --takers none,noise-4,calls-12 --out build/sample

An interrupted run can continue. `physment-eval calibrate` accepts the same folder. A taker is milder than another if
none of its handicaps is larger. A scene fails if the milder of two takers has fewer right answers, by more than half
the number of seeds.
"""

import argparse
import subprocess
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from evaluator.agents.takers import TAKER, TAKERS, parse_handicap
from evaluator.records.episode import Verdict
from evaluator.store.run_folder import RunFolder
from tests.builders.paths import ROOT

Right = Mapping[tuple[int, str], int]
"""Scene and taker → number of right answers."""


class Inversion(NamedTuple):
    """A scene in which the milder of two synthetic takers is right less often than the other."""

    scene: int
    milder: str
    severer: str
    excess: int
    """How many more right answers the other taker has."""


def inversions(right: Right, seeds: int) -> Iterator[Inversion]:
    """Yield the pairs of takers that a scene puts in the wrong order.

    Args:
        right: Right answers of each taker in each scene.
        seeds: Number of answers of each taker in a scene.
    """
    handicaps = {taker: parse_handicap(taker) for taker in dict.fromkeys(taker for _, taker in right)}
    for scene in dict.fromkeys(scene for scene, _ in right):
        for milder, less in handicaps.items():
            for severer, more in handicaps.items():
                excess = right[scene, severer] - right[scene, milder]
                if less != more and less.is_within(more) and excess > seeds / 2:
                    yield Inversion(scene, milder, severer, excess)


def counted(folder: RunFolder, takers: Sequence[str]) -> tuple[Right, int]:
    """The right answers of each taker in each scene, and the number of seeds."""
    found = dict.fromkeys(((scene, taker) for scene in folder.read_run().plan.scenes for taker in takers), 0)
    for key, grade in folder.grades().items():
        found[key.scene, key.agent.removeprefix(TAKER)] += grade.grade.strict is Verdict.CORRECT
    return found, len(folder.read_run().plan.seeds)


def report(right: Right, seeds: int) -> Iterator[str]:
    """Yield the lines of the report: each taker's share of right answers, then the scenes that rank takers wrongly."""
    scenes, takers = list(dict.fromkeys(scene for scene, _ in right)), list(dict.fromkeys(name for _, name in right))
    for taker in takers:
        yield f"{taker:24} {_mean(right[scene, taker] / seeds for scene in scenes):.3f}"
    pairs, wrong = list(inversions(right, seeds)), dict[int, list[Inversion]]()
    for pair in pairs:
        wrong.setdefault(pair.scene, []).append(pair)
    for scene, found in wrong.items():
        worst = max(found, key=lambda pair: pair.excess)
        said = f"{worst.milder} {right[scene, worst.milder]}, {worst.severer} {right[scene, worst.severer]} of {seeds}"
        yield f"scene {scene}: {len(found)} pairs in the wrong order, such as {said}"
    alike = [scene for scene in scenes if len({right[scene, taker] for taker in takers}) == 1]
    yield f"scenes in which all takers are right equally often: {', '.join(map(str, alike)) or 'none'}"
    yield f"ordered in {len(scenes) - len(wrong)} of {len(scenes)} scenes"


def _mean(values: Iterable[float]) -> float:
    shares = list(values)
    return sum(shares) / len(shares)


def main() -> int:
    """Play the episodes that the run folder does not contain yet, and print the report."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--scenes", default="7-111", metavar="SEL", help="such as 7-20 (default: 7-111)")
    parser.add_argument("--seeds", default="0-2", metavar="N,…", help="seeds (default: 0-2)")
    parser.add_argument("--takers", default=",".join(TAKERS), metavar="NAME,…", help="takers (default: all)")
    parser.add_argument("--workers", default="2", metavar="N", help="processes (default: 2)")
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "takers", help="run folder")
    options = parser.parse_args()
    takers = options.takers.split(",")
    matrix = ["--scenes", options.scenes, "--seeds", options.seeds, "--server", "host", "--workers", options.workers]
    agents = [word for taker in takers for word in ("--agent", f"{TAKER}{taker}")]
    words = [*matrix, *agents, "--concurrency", options.workers, "--out", str(options.out), "--resume"]
    done = subprocess.run([sys.executable, "-m", "evaluator", "run", *words], check=False)
    if done.returncode:
        return done.returncode
    print(*report(*counted(RunFolder(options.out), takers)), sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
