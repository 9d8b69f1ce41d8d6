"""Helpers for tests of films: they play runs in this process, and parse film files."""

import base64
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import anyio

from evaluator.agents.reference import ScriptedAgent
from evaluator.certify.verify import MemoryConnector
from evaluator.episode.loop import play_episode
from evaluator.records.episode import EpisodeKey, ToolCall
from evaluator.records.run import Plan, RunRecord, ServerRecord
from evaluator.report.agent_results import Run
from evaluator.report.attachments import attached, film_file
from evaluator.store.run_folder import RunFolder
from scenes import find_pack, pack_hash
from tests.builders.records import RIGHT, VERSIONS, episode_key
from tests.builders.scored import scored

Turns = Sequence[Sequence[ToolCall]]


def stored_run(folder: Path, *played: tuple[EpisodeKey, Turns]) -> RunFolder:
    """Store a run folder whose episodes consist of these calls."""
    run = RunFolder(folder)
    run.create(resume=False)
    plan = Plan(scenes=tuple({key.scene for key, _ in played}), agents=("x",))
    run.write_run(RunRecord(created_at="2026-01-01T00:00:00+00:00", plan=plan, server=ServerRecord(option="host")))

    async def play() -> None:
        laboratory = MemoryConnector()
        for key, turns in played:
            agent = ScriptedAgent("x", {None: tuple(map(tuple, turns))})
            versions = VERSIONS.model_copy(update={"pack": pack_hash(find_pack(key.scene))})
            async with laboratory.open(key.scene, key.seed) as client:
                run.append_episode(await play_episode(agent, client, key, versions, laboratory.toolboxes))

    anyio.run(play)
    return run


def key_of(scene: int, turns: Turns, seed: int = 0) -> EpisodeKey:
    """Return the key of an episode whose budget is exactly these turns."""
    return episode_key(scene, seed=seed, budget=len(turns))


def record_of(run: RunFolder, key: EpisodeKey) -> str:
    """Return the SHA-256 of an episode's record; its film contains the same hash."""
    return run.line_hashes()[key]


def file_of(run: RunFolder, key: EpisodeKey) -> Path:
    """Return the path of an episode's film."""
    return film_file(run.path, record_of(run, key))


def attached_run(run: RunFolder, target: Path | None = None) -> Run:
    """Return a run as a report shows it, with its films and frames attached to the page."""
    rows = [scored(episode, RIGHT) for episode in run.episodes().values()]
    target = target or run.path
    return Run(run.path.name, run.read_run(), rows, {}, attached(run, [row.episode for row in rows], target))


def read_film(run: RunFolder, key: EpisodeKey) -> dict[str, Any]:
    """Parse the file of a film."""
    text = file_of(run, key).read_text(encoding="utf-8")
    found = re.fullmatch(r"physmentFilm\((.*)\);\n", text)
    assert found
    return json.loads(found[1])


def decoded(film: Mapping[str, Any]) -> tuple[list[float], dict[str, list[list[float]]]]:
    """Decode a film as the player does.

    Returns:
        The times [s]; body → x, y, z [m] and quaternion at each time.
    """
    data = iter(base64.b64decode(film["data"]))
    times = [micro / 1e6 for micro in course(data, film["count"])]
    units = [film["step"]] * 3 + [film["turn"]] * 4
    columns = {
        name: [[unit * value for value in course(data, film["count"])] for unit in units] for name in film["bodies"]
    }
    assert next(data, None) is None
    return times, {name: [list(pose) for pose in zip(*found, strict=True)] for name, found in columns.items()}


def course(data: Iterator[int], count: int) -> list[int]:
    """Decode the next sequence of integers."""
    values: list[int] = []
    zeros = 0
    for place in range(count):
        if zeros:
            zeros, difference = zeros - 1, 0
        elif (written := _base128(data)) == 0:
            zeros, difference = _base128(data), 0
        else:
            difference = -(written + 1) // 2 if written % 2 else written // 2
        before, last = values[-2:] if place > 1 else [0, values[-1]] if place else [0, 0]
        values.append(difference + (2 * last - before if place > 1 else last))
    return values


def _base128(data: Iterator[int]) -> int:
    value = shift = 0
    while True:
        byte = next(data)
        value |= (byte & 127) << shift
        shift += 7
        if byte < 128:
            return value
