"""Is the reference right on seeds that nobody chose? They follow from the hash of each pack: a changed one has others.

Plays the reference in memory on so many seeds of each scene, keeps every verdict in a file, and goes on where an
interrupted run was: python -m tests.harness.fresh_seeds [--scenes SEL] [--count N] [--workers N] [--out FILE]
"""

import argparse
import hashlib
import json
import os
import sys
from collections import defaultdict
from collections.abc import Iterable
from functools import partial
from pathlib import Path

import anyio
from anyio import to_process

from evaluator.certify.certificate import play_reference
from evaluator.certify.in_memory import MemoryConnector
from evaluator.certify.subject import Subject
from evaluator.durable import append_line
from evaluator.study.selection import parse_scenes
from scenes import PackFiles, default_folder, pack_hash
from tests.builders.paths import ROOT


def seeds_of(pack: str, count: int) -> list[int]:
    """The seeds that follow from the hash of a pack, from 1000 on: none of them was used to make it."""
    digests = (hashlib.sha256(f"{pack}:{number}".encode()).digest() for number in range(count))
    return [1000 + int.from_bytes(digest[:4], "big") for digest in digests]


def verdict(files: PackFiles, seed: int) -> dict[str, object]:
    """The reference's answer at a seed, its key, and whether it is right."""
    subject = Subject.open(files)
    episode = anyio.run(play_reference, subject, seed, MemoryConnector(default_folder()))
    key = subject.truth(subject.draw(seed))
    right = episode.answer is not None and subject.agrees(episode.answer, key)
    return {"pack": pack_hash(files), "scene": files.scene_id, "seed": seed, "right": right,
            "answer": episode.answer, "key": key}  # fmt: skip


async def play(jobs: Iterable[tuple[PackFiles, int]], workers: int, out: Path) -> None:
    """Play in parallel processes; every verdict is on disk as soon as it is there."""
    limiter = anyio.CapacityLimiter(workers)

    async def one(files: PackFiles, seed: int) -> None:
        found = await to_process.run_sync(partial(verdict, files, seed), cancellable=True, limiter=limiter)
        append_line(out, json.dumps(found).encode())

    async with anyio.create_task_group() as tasks:
        for files, seed in jobs:
            tasks.start_soon(one, files, seed)


def main() -> int:
    """Play, and print the scenes in which the reference is wrong."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--scenes", metavar="SEL", help="such as 7-111 (default: all)")
    parser.add_argument("--count", type=int, default=60, help="seeds of each scene (default: 60)")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes (default: processors)")
    parser.add_argument(
        "--out", type=Path, default=ROOT / "build" / "fresh_seeds.jsonl", help="where verdicts are kept"
    )
    options = parser.parse_args()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    options.out.parent.mkdir(parents=True, exist_ok=True)
    packs = parse_scenes(options.scenes, None)
    wanted = [(files, seed) for files in packs for seed in seeds_of(pack_hash(files), options.count)]
    there = _kept(options.out)
    anyio.run(play, [job for job in wanted if (pack_hash(job[0]), job[1]) not in there], options.workers, options.out)
    there, wrong = _kept(options.out), defaultdict[int, list[int]](list)
    for files, seed in wanted:
        if not there[pack_hash(files), seed]:
            wrong[files.scene_id].append(seed)
    print(f"right on all {options.count} seeds in {len(packs) - len(wrong)} of {len(packs)} scenes")
    for scene, seeds in sorted(wrong.items()):
        print(f"scene {scene}: wrong at {', '.join(map(str, seeds))}")
    return 1 if wrong else 0


def _kept(out: Path) -> dict[tuple[str, int], bool]:
    lines = out.read_text(encoding="utf-8").splitlines() if out.exists() else []
    found = [json.loads(line) for line in lines]
    return {(line["pack"], line["seed"]): line["right"] for line in found}


if __name__ == "__main__":
    sys.exit(main())
