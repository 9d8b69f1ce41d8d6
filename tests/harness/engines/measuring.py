"""Measures the scenes on the MuJoCo version of its environment, and prints one line of JSON for each scene.

python -m tests.harness.engines.measuring --seeds N --jobs N [--scenes SEL]
"""

import argparse
import json
import platform
import sys
from collections.abc import Generator, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from importlib.metadata import version
from multiprocessing import get_context
from typing import Any

import anyio

from evaluator.certify.subject import Subject
from evaluator.certify.verify import MemoryConnector, play_reference
from evaluator.library import grade
from evaluator.records.episode import Verdict
from evaluator.study.selection import parse_scenes
from scenes import PackFiles


def measured(files: PackFiles, seeds: int) -> dict[str, Any]:
    """Measure one scene.

    Returns:
        The engine's keys at seeds 0, 1, …, and the grade of the reference agent at seed 0, played over MCP in memory.
    """
    versions = {"engine": version("mujoco"), "python": platform.python_version()}
    found: dict[str, Any] = {"scene": files.scene_id, **versions, "keys": [], "right": False}
    try:
        subject = Subject.open(files)
        found["keys"] = [subject.measured(subject.draw(seed)) for seed in range(seeds)]
        episode = anyio.run(play_reference, subject, 0, MemoryConnector(files.folder.parent))
        verdict = grade(episode).grade
        found |= {"right": verdict.strict is Verdict.CORRECT, "why": episode.error or verdict.reason}
    except Exception as error:  # noqa: BLE001 - on another engine, the pack's code may fail in any way
        found["why"] = repr(error)
    return found


def each_measured(packs: Iterable[PackFiles], seeds: int, jobs: int) -> Generator[dict[str, Any]]:
    """As `measured`, for several scenes in parallel processes."""
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        yield from pool.map(partial(measured, seeds=seeds), packs)


def main(argv: Sequence[str]) -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", help="such as 7,9 (default: all, open worlds too)")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--jobs", type=int, default=1)
    args = parser.parse_args(argv)
    for found in each_measured(parse_scenes(args.scenes, None), args.seeds, args.jobs):
        sys.stdout.write(json.dumps(found, default=float) + "\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
