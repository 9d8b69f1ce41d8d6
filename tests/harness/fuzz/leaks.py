"""Searches for leaks of answer keys: initial differences between seeds, and fixed lists of calls that give the key.

python -m tests.harness.fuzz.leaks [--scenes 7,20-25] [--minutes N] [--batches N] [--seed N]

A fixed list is expected to answer a scene whose task is one measurement, but not one that asks for a law. The search
covers only numeric answers; of an answer with several numbers, it covers the first.
"""

import argparse
import json
import random
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import anyio
import numpy as np
from mcp import Client
from rich.console import Console

from evaluator.answers.engine import all_readings
from evaluator.certify.subject import Subject
from evaluator.certify.twins import same
from physment_mcp.library import OpenEpisode
from physment_mcp.scene import scene_ids
from physment_mcp.session import Session
from scenes import find_pack
from tests.harness.fuzz.batches import draw_batch, play_batch
from tests.harness.fuzz.formulas import Array, Fit, Tolerance, best_formula
from tests.harness.fuzz.run import parse_scenes

FITTED, HELD_OUT = 24, 12
"""Numbers of seeds on which formulas are fitted and judged."""
PAIRS = 4
"""Number of seeds that are compared with seed 0."""
_RESOURCES = ("scene", "episode", "scenes", "measurements", "measurements/1")
_ROW = "{:>5}  {:>7}  {:>7}  {:>5}  {}"


@dataclass(frozen=True, slots=True)
class Finding:
    """Result of the search in one scene."""

    scene: int
    twins: str
    """An initial difference between two seeds; empty if there is none."""
    batches: int
    constant: Fit | None
    """The best answer without any call; None if the key is not a number."""
    best: Fit | None
    """The best formula over all batches, by the seeds on which it was fitted."""


async def published(session: Session) -> dict[str, Any]:
    """Return everything that a client can read of an episode through MCP before its first call."""
    async with Client(OpenEpisode(session).server(), cache=None) as client:
        found: dict[str, Any] = {"instructions": client.instructions, "server": str(client.server_info)}
        found["tools"] = (await client.list_tools()).model_dump_json()
        found["prompts"] = (await client.list_prompts()).model_dump_json()
        found["resources"] = (await client.list_resources()).model_dump_json()
        found["templates"] = (await client.list_resource_templates()).model_dump_json()
        for protocol in ("native", "text"):
            asked = await client.get_prompt("scene", {"prompting": "few-shot-cot", "protocol": protocol})
            found[f"prompt, {protocol}"] = asked.model_dump_json()
        for name in _RESOURCES:
            content = (await client.read_resource(f"physment://{name}")).model_dump(mode="json")
            found[name] = json.dumps(content)
    return found


async def revealing(subject: Subject, pairs: int = PAIRS) -> str:
    """Return an initial difference between seed 0 and a seed with another key; empty if there is none."""
    base = subject.draw(0)
    first = await _at_start(subject.session_to_compare(base))
    seeds = [
        seed for seed in range(1, 40) if not subject.agrees(subject.truth(subject.draw(seed)), subject.truth(base))
    ]
    for seed in seeds[:pairs]:
        other = await _at_start(subject.session_to_compare(subject.draw(seed)))
        if first.keys() != other.keys():
            return f"the list of objects (seed {seed})"
        told = [name for name in first if not same(first[name], other[name])]
        if told:
            return f"{told[0]} (seed {seed})"
    return ""


async def _at_start(session: Session) -> dict[str, Any]:
    return await published(session) | dict(await all_readings(session))


def search(subject: Subject, until: float, least: int, source: random.Random) -> tuple[int, Fit | None, Fit | None]:
    """Play random batches until a deadline, but at least `least` of them.

    Returns:
        The number of batches, the best constant and the best formula.
    """
    draws = [subject.draw(seed) for seed in range(FITTED + HELD_OUT)]
    keys = _first_numbers([subject.truth(draw) for draw in draws])
    if keys is None:
        return 0, None, None
    sessions = [subject.session(draw) for draw in draws]
    tolerance = Tolerance(subject.spec.abs_tol, subject.spec.rel_tol)
    constant = best_formula(np.zeros((len(keys), 0)), [], keys, FITTED, tolerance)
    best, batches = constant, 0
    while batches < least or time.perf_counter() < until:
        features, names = play_batch(sessions, draw_batch(sessions[0], source))
        best = max(best, best_formula(features, names, keys, FITTED, tolerance), key=lambda fit: fit.fitted)
        batches += 1
    return batches, constant, best


def _first_numbers(truths: Sequence[object]) -> Array | None:
    parts = [truth[0] if isinstance(truth, list | tuple) else truth for truth in truths]
    return None if any(isinstance(part, str) for part in parts) else np.array(parts, dtype=np.float64)


def finding(scene: int, seconds: float, least: int, source: random.Random) -> Finding:
    """Search one scene for about `seconds`, with at least `least` batches."""
    until = time.perf_counter() + seconds
    subject = Subject.open(find_pack(scene, None))
    twins = anyio.run(revealing, subject)
    return Finding(scene, twins, *search(subject, until, least, source))


def main(argv: Sequence[str]) -> int:
    """Print a row for each scene; returns 1 if two seeds differ initially."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=parse_scenes, help="such as 7,20-25; the whole suite by default")
    parser.add_argument("--minutes", type=float, default=30.0, help="for all scenes together (%(default)s)")
    parser.add_argument("--batches", type=int, default=1, help="at least so many for each scene (%(default)s)")
    parser.add_argument("--seed", type=int, default=1, help="of the batches (%(default)s)")
    args = parser.parse_args(argv)
    scenes = args.scenes or scene_ids()
    console, differing = Console(soft_wrap=True, highlight=False), 0
    console.print(
        f"Shares of {HELD_OUT} seeds held out\n{_ROW.format('scene', 'batches', 'no call', 'batch', 'formula')}"
    )
    for scene in scenes:
        source = random.Random(f"{args.seed}:{scene}")
        found = finding(scene, 60 * args.minutes / len(scenes), args.batches, source)
        differing += bool(found.twins)
        shares = [f"{fit.held_out:.0%}" if fit else "" for fit in (found.constant, found.best)]
        formula = found.best.formula if found.best else "the key is no number"
        console.print(_ROW.format(scene, found.batches, *shares, formula), markup=False)
        if found.twins:
            console.print(f"      twins differ at the start in {found.twins}", markup=False)
    console.print(f"twins differ in {differing} of {len(scenes)} scenes")
    return int(bool(differing))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
