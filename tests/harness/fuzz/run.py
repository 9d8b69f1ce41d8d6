"""Makes random tool calls on every scene of the suite and checks the invariants after each call.

Then sends malformed JSON-RPC frames to a live host and to a server on stdio.

python -m tests.harness.fuzz.run [--calls N] [--frames N] [--seed N] [--scenes 7,20-25] [--jobs N] [--out DIR]
python -m tests.harness.fuzz.run --replay FILE
"""

import argparse
import asyncio
import contextlib
import multiprocessing
import os
import random
import sys
import time
from collections.abc import Generator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

from rich.console import Console

from physment_mcp.scene import scene_ids
from tests.harness.fuzz.episodes import Failure, Tally, play_scene, replayed
from tests.harness.fuzz.frames import over_http, over_stdio

CALLS = 200_000
FRAMES = 5000
_OUT = Path("build/fuzz")
_SHARE = 1000
"""Most calls that a process makes on one scene before it goes on to another."""


def parse_scenes(text: str) -> list[int]:
    """Parse a selection of scene ids such as `7,20-25`.

    Raises:
        argparse.ArgumentTypeError: A part is not a number or a range, or the selection contains no scene of the suite.
    """
    try:
        bounds = [[int(bound) for bound in part.split("-", 1)] for part in text.split(",")]
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not like 7,20-25") from error
    found = [scene for scene in scene_ids() if any(bound[0] <= scene <= bound[-1] for bound in bounds)]
    if not found:
        raise argparse.ArgumentTypeError(f"no scene of the suite is among {text}")
    return found


def play_all(scenes: Sequence[int], count: int, seed: int, jobs: int) -> Generator[tuple[int, Tally]]:
    """Make the calls in several processes; yields the result of each scene when it is complete.

    The calls depend only on scenes, count and seed, and not on the number of processes.
    """
    each = [count // len(scenes) + (place < count % len(scenes)) for place in range(len(scenes))]
    work = [
        (scene, min(_SHARE, calls - start), seed * 1000 + start // _SHARE)
        for scene, calls in zip(scenes, each, strict=True)
        for start in range(0, calls, _SHARE)
    ]
    if jobs == 1:
        yield from ((scene, play_scene(scene, calls, drawn)) for scene, calls, drawn in work)
        return
    with ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn")) as pool:
        for (scene, _, _), tally in zip(work, pool.map(_play, work), strict=True):
            yield scene, tally


def _play(work: tuple[int, int, int]) -> Tally:
    return play_scene(*work)


def replay(file: Path, console: Console) -> int:
    """Repeat the calls of a stored failure; returns 1 if they still fail."""
    failure = Failure.read(file)
    problem = replayed(failure)
    said = "the calls fail no more" if problem is None else f"{problem.kind}: {problem.detail}"
    console.print(f"scene {failure.scene}, seed {failure.seed}, {len(failure.calls)} calls: {said}", markup=False)
    return int(problem is not None)


def fuzz(args: argparse.Namespace, console: Console) -> int:
    """Run the fuzzer as the command line requests, and print the failures; returns 1 if there are any."""
    scenes = args.scenes or scene_ids()
    seed = random.SystemRandom().randrange(10**6) if args.seed is None else args.seed
    console.print(f"{args.calls} calls on {len(scenes)} scenes, --seed {seed}", highlight=False)
    tally, started = Tally(), time.perf_counter()
    with contextlib.closing(play_all(scenes, args.calls, seed, args.jobs)) as playing:
        for _, played in playing:
            tally.calls += played.calls
            tally.refused += played.refused
            tally.episodes += played.episodes
            for failure in played.failures:
                tally.failures.append(failure)
                file = failure.write(args.out)
                console.print(
                    f"scene {failure.scene}: {failure.problem.kind}: {failure.problem.detail}"[:1500], markup=False
                )
                console.print(f"  {len(failure.calls)} calls in {file}", highlight=False)
    took, made = time.perf_counter() - started, tally.calls.total()
    console.print(
        f"{made} calls ({tally.refused.total()} refused) in {tally.episodes} episodes took {took:.0f} s,"
        f" {made / took:.0f} a second; failures: {len(tally.failures)}",
        highlight=False,
    )
    return int(bool(tally.failures) + frames(args.frames, seed, console) > 0)


def frames(count: int, seed: int, console: Console) -> int:
    """Send half of the frames over each transport; returns how many invariants they broke."""
    if not count:
        return 0
    broken = [*asyncio.run(over_http(count // 2, seed)), *asyncio.run(over_stdio(count - count // 2, seed))]
    for problem in broken:
        console.print(problem[:3000], markup=False)
    console.print(f"{count} frames; failures: {len(broken)}", highlight=False)
    return len(broken)


def main(argv: Sequence[str]) -> int:
    """Play or replay; returns 1 if an invariant was broken."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--calls", type=int, default=CALLS, help="how many calls, over all scenes (%(default)s)")
    parser.add_argument("--frames", type=int, default=FRAMES, help="how many frames (%(default)s)")
    parser.add_argument("--seed", type=int, help="of everything that is drawn; printed, and random by default")
    parser.add_argument("--scenes", type=parse_scenes, help="such as 7,20-25; the whole suite by default")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="processes (%(default)s)")
    parser.add_argument("--out", type=Path, default=_OUT, help="folder for failures (%(default)s)")
    parser.add_argument("--replay", type=Path, metavar="FILE", help="make the calls of a failure again")
    args = parser.parse_args(argv)
    console = Console(soft_wrap=True)
    return replay(args.replay, console) if args.replay else fuzz(args, console)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
