"""Compares the errors of the reference agent with the bounds that the evidence meter computes for its experiments.

Plays the reference in memory and computes the bounds of each episode: the first seed of every scene, then the second,
and so on. Rival laws and discrete values do not change the bounds and are not tested. An error divided by its bound has
a mean square of 1 if the bound is right and the reference loses no information. The column `linear` is the ratio of the
linear estimate at the true values, which loses none: it tests the covariance of the readings alone. `--out` stores each
episode, so an interrupted run can continue; changed packs are played again. The default scenes have noise, ask for
numbers, and take a median of 5 s an episode.

In published scenes the noise is the same at all seeds, so the errors of different seeds are not independent. Here each
seed has noise of its own.

python -m tests.harness.evidence [--scenes SEL] [--seeds N] [--workers N] [--out FILE]
"""

import argparse
import contextlib
import json
import os
import sys
from collections import defaultdict
from collections.abc import AsyncGenerator, Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TypedDict, cast

import anyio
import numpy as np
from mcp import Client

from evaluator.certify.constants import Constants
from evaluator.certify.information import Information, information
from evaluator.certify.probing import Array, NotMeasurable, numbers
from evaluator.certify.processes import in_processes
from evaluator.certify.subject import Draw, Subject
from evaluator.certify.verify import play_reference
from evaluator.episode.toolbox import Toolboxes
from evaluator.records.episode import Episode
from evaluator.store.durable import append_line
from evaluator.study.selection import parse_scenes
from physment_mcp.library import OpenEpisode
from physment_mcp.world.world import NOISE_SALT
from scenes import PackFiles, pack_hash
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
    linear: list[float]
    """For each asked number, the error of the linear estimate at the true values over its bound."""
    why: str
    """Why the evidence cannot be measured; empty if it can."""


@dataclass(frozen=True, slots=True)
class OwnNoise:
    """Opens episodes of a scene over MCP in memory, with noise that depends on the seed."""

    subject: Subject
    toolboxes: Toolboxes = field(default_factory=Toolboxes, repr=False, compare=False)

    @contextlib.asynccontextmanager
    async def open(self, scene: int, seed: int) -> AsyncGenerator[Client]:
        """Open a new episode and yield a client connected to it."""
        del scene
        draw = self.subject.draw(seed)
        mjcf = draw.mjcf if f'"{NOISE_SALT}"' in draw.mjcf else _salted(draw.mjcf, seed)
        server = OpenEpisode(self.subject.session(Draw(draw.knobs, mjcf))).server()
        async with Client(server, cache=None) as client:
            yield client


def _salted(mjcf: str, seed: int) -> str:
    """Add the text element that determines the noise to a model without one."""
    body, end, rest = mjcf.rpartition("</mujoco>")
    return f'{body}<custom><text name="{NOISE_SALT}" data="seed {seed}"/></custom>{end}{rest}'


def errors_of(files: PackFiles, seed: int) -> Measured:
    """Play the reference at a seed, and divide each error of its answer by the bound."""
    subject = Subject.open(files)
    episode = anyio.run(play_reference, subject, seed, OwnNoise(subject))
    constants = Constants.of(subject, seed)
    key = constants.key
    why, bounds, linear = "", list[float](), list[float]()
    try:
        told = information(constants, episode)
        fisher = told.fisher(range(len(told.calls)))
        bounds = constants.bounds(fisher)
        linear = linear_errors(constants.steps(fisher), told, _stored(told, episode))
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
            "linear": linear, "why": why}  # fmt: skip


def linear_errors(steps: Array, told: Information, read: Array) -> list[float]:
    """Return the error of the linear estimate of each requested number, divided by its bound.

    Args:
        steps: Shifts of the constants by one standard error of each number, as returned by `Constants.steps`.
        told: The information of the readings.
        read: The readings, with their errors.
    """
    errors = told.whiten @ np.where(told.ignored, 0.0, read - told.values)
    return [float(error) for error in steps @ told.whitened.T @ errors]


def _stored(told: Information, episode: Episode) -> Array:
    """The readings as the agent received them."""
    contents = [exchange.content for _, exchange in episode.accepted_calls()]
    return np.array([number for one in told.reads for number in numbers(contents[one.place])])


def spread(errors: Sequence[float]) -> float:
    """Return the root mean square of errors that are divided by their bounds."""
    return float(np.sqrt(np.mean(np.square(errors))))


def outside(ratios: Mapping[int, float]) -> list[int]:
    """Return the scenes whose ratio of spread to bound is not in the expected range."""
    return [scene for scene, ratio in ratios.items() if not LOW <= ratio <= HIGH]


def kept(file: Path, hashes: Mapping[int, str]) -> list[Measured]:
    """Read the stored episodes of packs that have not changed; not those of earlier versions, with common noise."""
    lines = file.read_bytes().split(b"\n")[:-1] if file.exists() else []
    found = [cast("Measured", json.loads(line)) for line in lines]
    return [one for one in found if hashes.get(one["scene"]) == one["pack"] and "linear" in one]


def table(found: Iterable[Measured]) -> Iterator[str]:
    """Yield the lines of the table of results."""
    by_scene: defaultdict[int, list[Measured]] = defaultdict(list)
    for one in found:
        by_scene[one["scene"]].append(one)
    ratios: dict[int, float] = {}
    yield "scene  seeds  right  ratio  median-based  largest  linear"
    for scene, episodes in sorted(by_scene.items()):
        errors = [error for one in episodes for error in one["errors"]]
        counts = f"{scene:5d}  {len(episodes):5d}  {sum(one['right'] for one in episodes):5d}"
        if not errors:
            yield f"{counts}  not measurable: {episodes[0]['why']}"
            continue
        ratios[scene], sizes = spread(errors), np.abs(errors)
        linear = spread([error for one in episodes for error in one["linear"]])
        yield f"{counts}  {ratios[scene]:5.2f}  {np.median(sizes) / 0.6745:12.2f}  {sizes.max():7.2f}  {linear:6.2f}"
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
