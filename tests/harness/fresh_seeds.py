"""Measures how often the reference agent is right on seeds that nobody chose: they follow from the hash of each pack.

The agent plays in memory: the first seed of every scene, then the second, and so on. `--out` stores each verdict, so an
interrupted run can continue. `fresh_seeds.json` beside this module is the committed summary: for each scene the hash of
its pack, the number of its seeds that were played, and the seeds at which the agent was wrong. Unchanged packs are not
played again. The checks that a run makes before it plays a seed (`evaluator.certify.seed_proofs`) are stricter.

python -m tests.harness.fresh_seeds [--scenes SEL] [--count N] [--workers N] [--out FILE]
"""

import argparse
import hashlib
import json
import os
import sys
from collections.abc import Iterable, Mapping
from functools import partial
from itertools import takewhile
from pathlib import Path
from typing import TypedDict

import anyio

from evaluator.certify.processes import in_processes
from evaluator.certify.subject import Subject
from evaluator.certify.verify import MemoryConnector, play_reference
from evaluator.store.durable import append_line
from evaluator.study.selection import parse_scenes
from scenes import PackFiles, default_folder, pack_hash
from tests.builders.paths import ROOT


def seeds_of(pack: str, count: int) -> list[int]:
    """Return seeds computed from the hash of a pack.

    They start at 1000, because smaller seeds are used by certificates and splits.
    """
    digests = (hashlib.sha256(f"{pack}:{number}".encode()).digest() for number in range(count))
    return [1000 + int.from_bytes(digest[:4], "big") for digest in digests]


def verdict(files: PackFiles, seed: int) -> dict[str, object]:
    """Return the reference's answer at a seed, its key, and whether the answer is right."""
    subject = Subject.open(files)
    episode = anyio.run(play_reference, subject, seed, MemoryConnector(default_folder()))
    key = subject.truth(subject.draw(seed))
    right = episode.answer is not None and subject.agrees(episode.answer, key)
    return {"pack": pack_hash(files), "scene": files.scene_id, "seed": seed, "right": right,
            "answer": episode.answer, "key": key}  # fmt: skip


async def play(jobs: Iterable[tuple[PackFiles, int]], workers: int, out: Path) -> None:
    """Play in parallel processes, and append each verdict to a file as soon as it is known."""

    def done(_job: tuple[PackFiles, int], found: dict[str, object]) -> None:
        append_line(out, json.dumps(found).encode())

    await in_processes(jobs, lambda job: partial(verdict, *job), workers, done)


SUMMARY = Path(__file__).with_name("fresh_seeds.json")


def main() -> int:
    """Play, write the summary, and print the scenes in which the reference is wrong."""
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
    there = _summarised(packs) | _kept(options.out)
    hashed = [(files, pack_hash(files)) for files in packs]
    wanted = [
        [(files, seed, (pack, seed) in there) for seed in seeds_of(pack, options.count)] for files, pack in hashed
    ]
    jobs = [(files, seed) for turn in zip(*wanted, strict=True) for files, seed, known in turn if not known]
    try:
        anyio.run(play, jobs, options.workers, options.out)
    finally:
        found = _rows(packs, there | _kept(options.out), options.count)
        SUMMARY.write_text(json.dumps(_stored_rows() | found, indent=0) + "\n", encoding="utf-8")
    wrong = {scene: row["wrong"] for scene, row in found.items() if row["wrong"]}
    print(f"right on all {options.count} seeds in {len(packs) - len(wrong)} of {len(packs)} scenes")
    for scene, seeds in wrong.items():
        print(f"scene {scene}: wrong at {', '.join(map(str, seeds))}")
    return 1 if wrong else 0


class Row(TypedDict):
    """The result for one scene: how many of its seeds were played, and those at which the reference failed."""

    pack: str
    played: int
    wrong: list[int]


def _stored_rows() -> dict[str, Row]:
    return json.loads(SUMMARY.read_text(encoding="utf-8")) if SUMMARY.exists() else {}


def _summarised(packs: Iterable[PackFiles]) -> dict[tuple[str, int], bool]:
    """Return the verdicts of the summary, without those on packs that changed after it was written."""
    rows = _stored_rows()
    return {
        (row["pack"], seed): seed not in row["wrong"]
        for files in packs
        if (row := rows.get(str(files.scene_id))) and row["pack"] == pack_hash(files)
        for seed in seeds_of(row["pack"], row["played"])
    }


def _rows(packs: Iterable[PackFiles], verdicts: Mapping[tuple[str, int], bool], count: int) -> dict[str, Row]:
    """Return a row for each scene, which counts only the seeds before the first one without a verdict."""
    rows: dict[str, Row] = {}
    for files in packs:
        pack = pack_hash(files)
        played = list(takewhile(lambda seed, pack=pack: (pack, seed) in verdicts, seeds_of(pack, count)))
        rows[str(files.scene_id)] = Row(
            pack=pack, played=len(played), wrong=[seed for seed in played if not verdicts[pack, seed]]
        )
    return rows


def _kept(out: Path) -> dict[tuple[str, int], bool]:
    lines = out.read_text(encoding="utf-8").splitlines() if out.exists() else []
    found = [json.loads(line) for line in lines]
    return {(line["pack"], line["seed"]): line["right"] for line in found}


if __name__ == "__main__":
    sys.exit(main())
