"""Merging: the run folders of shards, or of parts of a study, become one run folder."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from evaluator.errors import UsageError
from evaluator.records.episode import Episode, EpisodeKey, Outcome
from evaluator.records.run import MergedPart, RunRecord
from evaluator.store.run_folder import RunFolder
from evaluator.study.played_worlds import worlds_difference
from evaluator.study.sealing import Sealing, seal_note
from scenes.world_names import reference_of


def expand(folders: Iterable[Path]) -> list[RunFolder]:
    """The run folders that were named; for a folder that holds shards, the shards.

    Raises:
        UsageError: A folder holds neither a run nor shards.
    """
    found: list[RunFolder] = []
    for folder in folders:
        shards = sorted(file.parent for file in folder.glob("shard-*/run.json"))
        if RunFolder(folder).run_file.exists():
            found.append(RunFolder(folder))
        elif shards:
            found += [RunFolder(shard) for shard in shards]
        else:
            raise UsageError(f"{folder} holds neither a run nor shards of one")
    return found


def merge(parts: Sequence[RunFolder], target: RunFolder, *, trust: bool = False) -> dict[EpisodeKey, Episode]:
    """Write the episodes of all parts into a new run folder, and return them.

    An episode that was played replaces the record of an infrastructure error. If two parts played the same episode,
    their records must be equal: nothing says which of two different records counts. The whole is sealed anew.

    Args:
        parts: The run folders.
        target: The new one.
        trust: Go on with records that do not fit to their seal; the seal of the whole says so.

    Raises:
        UsageError: The parts do not belong together.
        StoreError: A record is damaged or does not fit to its seal, or the target holds a run already.
    """
    records = [part.read_run() for part in parts]
    for part, record in zip(parts, records, strict=True):
        if name := records[0].difference(record):
            worlds = worlds_difference(records[0].worlds, record.worlds) if name == "worlds" else ""
            raise UsageError(
                f"{part.path} has other {name} than {parts[0].path}: "
                + (worlds or "their episodes do not belong together")
            )
    episodes: dict[EpisodeKey, Episode] = {}
    sources: dict[EpisodeKey, RunFolder] = {}
    for part in parts:
        for key, episode in part.episodes().items():
            known = episodes.get(key)
            if known is None or known.outcome is Outcome.INFRASTRUCTURE_ERROR:
                episodes[key], sources[key] = episode, part
            elif known != episode and episode.outcome is not Outcome.INFRASTRUCTURE_ERROR:
                raise UsageError(
                    f"{part.path} holds another record of scene {reference_of(key.scene)}, seed {key.seed},"
                    f" {key.agent}, budget {key.budget}, epoch {key.epoch} than the folders before it"
                )
    notes = [seal_note(part, trust=trust) for part in parts]
    target.create(resume=False)
    sealing = Sealing(target)
    whole = replace(target, on_line=sealing.add)
    for key, episode in episodes.items():
        whole.copy_frames(sources[key], episode)
        whole.append_episode(episode)
    edited = tuple(f"{part.path.name}: {note}" for part, note in zip(parts, notes, strict=True) if "NOT" in note)
    whole.write_seal(sealing.seal.model_copy(update={"edited": edited}))
    whole.write_run(_merged(parts, records))
    return episodes


def _merged(parts: Sequence[RunFolder], records: Sequence[RunRecord]) -> RunRecord:
    """The record of the first part, as that of the whole, with the start of each part."""
    merged = tuple(
        MergedPart(folder=part.path.name, shard=record.shard, resumed=record.resumed, **dict(record.start()))
        for part, record in zip(parts, records, strict=True)
    )
    return records[0].model_copy(update={"shard": None, "resumed": (), "merged": merged})
