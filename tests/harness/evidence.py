"""Compares the errors of the reference agent with the bounds that the evidence meter computes for its experiments.

Plays the reference in memory and computes the bounds of each episode: the first seed of every scene, then the second,
and so on. Rival laws and discrete values do not change the bounds and are not tested. An error divided by its bound has
a mean square of 1 if the bound is right and the reference loses no information. `--out` stores each episode, so an
interrupted run can continue; changed packs are played again. The default scenes have noise, ask for numbers, and take
a median of 5 s an episode.

python -m tests.harness.evidence [--scenes SEL] [--seeds N] [--workers N] [--out FILE]
"""

import argparse
import json
import os
import sys
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TypedDict, cast

import anyio
import numpy as np

from evaluator.certify.constants import Constants
from evaluator.certify.information import information
from evaluator.certify.parallel import in_processes
from evaluator.certify.probing import NotMeasurable
from evaluator.certify.subject import Subject
from evaluator.certify.verify import MemoryConnector, play_reference
from evaluator.store.durable import append_line
from evaluator.study.selection import parse_scenes
from scenes import PackFiles, default_folder, pack_hash
from tests.builders.paths import ROOT

SCENES = "33,35,36,40,76-91"
LOW, HIGH = 0.85, 1.5
"""Range in which the ratio of spread to bound is expected."""


class Measured(TypedDict):
    """An episode."""

    pack: str
    scene: int
    seed: int
    right: bool
    errors: list[float]
    """For each asked number, the error of the answer over its bound."""
    why: str
    """Why the evidence cannot be measured; empty if it can."""


def errors_of(files: PackFiles, seed: int) -> Measured:
    """Play the reference at a seed, and divide each error of its answer by the bound."""
    subject = Subject.open(files)
    episode = anyio.run(play_reference, subject, seed, MemoryConnector(default_folder()))
    constants = Constants.of(subject, seed)
    key = constants.key
    why, bounds = "", list[float]()
    try:
        told = information(constants, episode)
        bounds = constants.bounds(told.fisher(range(len(told.calls))))
    except NotMeasurable as error:
        why = str(error)
    answer = cast("object", episode.answer)
    parts = cast("list[object]", answer) if isinstance(answer, list) else [answer]
    errors = [
        (got - want) / (bound * (subject.spec.abs_tol + subject.spec.rel_tol * abs(want)))
        for got, want, bound in zip(parts, key, bounds, strict=False)
        if isinstance(got, int | float) and isinstance(want, int | float) and bound > 0
    ]
    right = episode.answer is not None and subject.agrees(episode.answer, key)
    return {"pack": pack_hash(files), "scene": files.scene_id, "seed": seed, "right": right, "errors": errors,
            "why": why}  # fmt: skip


def spread(errors: Sequence[float]) -> float:
    """Return the root mean square of errors that are divided by their bounds."""
    return float(np.sqrt(np.mean(np.square(errors))))


def outside(ratios: Mapping[int, float]) -> list[int]:
    """Return the scenes whose ratio of spread to bound is not in the expected range."""
    return [scene for scene, ratio in ratios.items() if not LOW <= ratio <= HIGH]


def kept(file: Path, hashes: Mapping[int, str]) -> list[Measured]:
    """Read the stored episodes of packs that have not changed."""
    lines = file.read_bytes().split(b"\n")[:-1] if file.exists() else []
    found = [cast("Measured", json.loads(line)) for line in lines]
    return [one for one in found if hashes.get(one["scene"]) == one["pack"]]


def table(found: Iterable[Measured]) -> Iterator[str]:
    """Yield the lines of the table of results."""
    by_scene: defaultdict[int, list[Measured]] = defaultdict(list)
    for one in found:
        by_scene[one["scene"]].append(one)
    ratios: dict[int, float] = {}
    yield "scene  seeds  right  ratio  median-based  largest"
    for scene, episodes in sorted(by_scene.items()):
        errors = [error for one in episodes for error in one["errors"]]
        counts = f"{scene:5d}  {len(episodes):5d}  {sum(one['right'] for one in episodes):5d}"
        if not errors:
            yield f"{counts}  not measurable: {episodes[0]['why']}"
            continue
        ratios[scene], sizes = spread(errors), np.abs(errors)
        yield f"{counts}  {ratios[scene]:5.2f}  {np.median(sizes) / 0.6745:12.2f}  {sizes.max():7.2f}"
    apart = outside(ratios)
    yield f"{len(ratios) - len(apart)} of {len(ratios)} scenes between {LOW} and {HIGH}; others: {apart or 'none'}"


def main() -> int:
    """Play, measure, and print the ratio of spread to bound of each scene."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("--scenes", metavar="SEL", default=SCENES, help=f"scenes (default: {SCENES})")
    parser.add_argument("--seeds", type=int, default=100, help="seeds of each scene, from 1 on (default: 100)")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes (default: processors)")
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "evidence.jsonl", help="where episodes are kept")
    options = parser.parse_args()
    options.out.parent.mkdir(parents=True, exist_ok=True)
    packs = parse_scenes(options.scenes, None)
    hashes = {files.scene_id: pack_hash(files) for files in packs}
    done = {(one["scene"], one["seed"]) for one in kept(options.out, hashes)}
    seeds = range(1, options.seeds + 1)
    jobs = [(files, seed) for seed in seeds for files in packs if (files.scene_id, seed) not in done]

    def work(job: tuple[PackFiles, int]) -> Callable[[], Measured]:
        return partial(errors_of, *job)

    def on_done(job: tuple[PackFiles, int], found: Measured) -> None:
        del job
        append_line(options.out, json.dumps(found).encode())

    anyio.run(in_processes, jobs, work, options.workers, on_done)
    for line in table(one for one in kept(options.out, hashes) if one["seed"] in seeds):
        sys.stdout.write(f"{line}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
