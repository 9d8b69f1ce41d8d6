"""Run folders of shards, or of parts of a study, put together into one."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from evaluator.errors import UsageError
from evaluator.records import Episode, EpisodeKey, Outcome
from evaluator.store import RunFolder

_DECIDING = ("plan", "packs", "agents")
"""What runs must have in common for their episodes to belong together."""


def expand(folders: Iterable[Path]) -> list[RunFolder]:
    """Run folders as they were named; of a folder that holds shards, the shards.

    Raises:
        UsageError: A folder holds neither a run nor shards.
    """
    found: list[RunFolder] = []
    for folder in folders:
        shards = sorted(one.parent for one in folder.glob("shard-*/run.json"))
        if RunFolder(folder).run_file.exists():
            found.append(RunFolder(folder))
        elif shards:
            found += [RunFolder(shard) for shard in shards]
        else:
            raise UsageError(f"{folder} holds neither a run nor shards of one")
    return found


def merge(parts: Sequence[RunFolder], target: RunFolder) -> dict[EpisodeKey, Episode]:
    """Write the episodes of all parts into a new run folder, and return them.

    An infrastructure error gives way to an episode that was played. Two parts that played one episode must hold the
    same record of it: which of them counts is not ours to choose.

    Raises:
        UsageError: The parts do not belong together.
        StoreError: A record is damaged, or the target holds a run already.
    """
    facts = [part.read_run() for part in parts]
    for part, one in zip(parts, facts, strict=True):
        for name in _DECIDING:
            if one.get(name) != facts[0].get(name):
                raise UsageError(
                    f"{part.path} has other {name} than {parts[0].path}: their episodes do not belong together"
                )
    episodes: dict[EpisodeKey, Episode] = {}
    for part in parts:
        for key, episode in part.episodes().items():
            before = episodes.get(key)
            if before is None or before.outcome is Outcome.INFRASTRUCTURE_ERROR:
                episodes[key] = episode
            elif before != episode and episode.outcome is not Outcome.INFRASTRUCTURE_ERROR:
                raise UsageError(
                    f"{part.path} holds another record of scene {key.scene}, seed {key.seed}, {key.agent},"
                    f" budget {key.budget}, epoch {key.epoch} than the folders before it"
                )
    target.create(resume=False)
    for episode in episodes.values():
        target.append_episode(episode)
    target.write_run(_facts(parts, facts))
    return episodes


def _facts(parts: Sequence[RunFolder], facts: Sequence[dict[str, Any]]) -> dict[str, Any]:
    merged = {name: value for name, value in facts[0].items() if name not in {"shard", "resumed"}}
    told = ("created_at", "server", "versions", "git_revision", "shard", "resumed")
    merged["merged"] = [
        {"folder": part.path.name, **{name: one[name] for name in told if name in one}}
        for part, one in zip(parts, facts, strict=True)
    ]
    return merged
