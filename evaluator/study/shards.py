"""Shards: a stable hash of the episode key divides a run among machines; `merge` joins their run folders."""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from evaluator.errors import UsageError
from evaluator.records.episode import Episode, EpisodeKey, Outcome
from evaluator.records.run import MergedPart, RunRecord
from evaluator.store.run_folder import RunFolder
from evaluator.study.integrity import Sealing, seal_note, worlds_difference
from scenes import reference_of

COUNT_VARIABLE = "PHYSMENT_SHARDS"
"""Environment variable with the number of shards, for schedulers that do not report it."""


@dataclass(frozen=True, slots=True)
class Shard:
    """One of several parts of a run."""

    index: int
    """Number of this shard, from 1 to `count`."""
    count: int

    def takes(self, key: EpisodeKey) -> bool:
        """Whether an episode belongs to this shard. The result is the same on every machine."""
        digest = hashlib.sha256(key.model_dump_json().encode()).digest()
        return int.from_bytes(digest[:8], "big") % self.count == self.index - 1

    @property
    def name(self) -> str:
        """Name of the shard's folder in the folder of the run. Names sort in the order of the shards."""
        width = len(str(self.count))
        return f"shard-{self.index:0{width}}-of-{self.count}"


WHOLE = Shard(1, 1)


def parse_shard(text: str) -> Shard:
    """Read `i/n`.

    Raises:
        UsageError: `text` is not two whole numbers with 1 ≤ i ≤ n.
    """
    index, slash, count = text.partition("/")
    if not slash or not index.isdecimal() or not count.isdecimal() or not 1 <= int(index) <= int(count):
        raise UsageError(f"--shard {text}: write i/n with i from 1 to n, such as 3/8")
    return Shard(int(index), int(count))


def shard_of_environment(environ: Mapping[str, str]) -> Shard:
    """The shard that a scheduler assigned to this process; the whole run if there is no scheduler.

    Source: `SLURM_ARRAY_TASK_ID`, `_MIN`, `_STEP` and `_COUNT` of a Slurm array; `JOB_COMPLETION_INDEX` of an indexed
    Kubernetes job, which does not give the number of shards.

    Raises:
        UsageError: The variables contradict each other, or the number of shards is missing.
    """
    try:
        if "SLURM_ARRAY_TASK_ID" in environ:
            first, step = int(environ.get("SLURM_ARRAY_TASK_MIN", "0")), int(environ.get("SLURM_ARRAY_TASK_STEP", "1"))
            count = int(environ.get("SLURM_ARRAY_TASK_COUNT") or environ[COUNT_VARIABLE])
            return _checked((int(environ["SLURM_ARRAY_TASK_ID"]) - first) // step + 1, count)
        if "JOB_COMPLETION_INDEX" in environ:
            return _checked(int(environ["JOB_COMPLETION_INDEX"]) + 1, int(environ[COUNT_VARIABLE]))
    except KeyError as missing:
        raise UsageError(
            f"the scheduler gave this process an index, but {missing} does not say of how many; set {COUNT_VARIABLE},"
            " or give --shard i/n (--shard 1/1 plays everything)"
        ) from None
    except ValueError as error:
        raise UsageError(f"the scheduler's shard cannot be read ({error}); give --shard i/n") from None
    return WHOLE


def _checked(index: int, count: int) -> Shard:
    if not 1 <= index <= count:
        raise UsageError(
            f"the scheduler says shard {index} of {count}; give --shard i/n (--shard 1/1 plays everything)"
        )
    return Shard(index, count)


def expand(folders: Iterable[Path]) -> list[RunFolder]:
    """Replace each folder that holds shards by the run folders of its shards.

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
    their records must be equal, because there is no rule to choose between different ones. The merged run gets a new
    seal.

    Args:
        parts: The run folders to merge.
        target: The folder of the merged run.
        trust: Whether to accept records that do not match their seal; the seal of the merged run says so.

    Raises:
        UsageError: The parts do not belong together.
        StoreError: A record is damaged or does not match its seal, or the target holds a run already.
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
    """Return the run record of the first part, extended by the starts of all parts."""
    merged = tuple(
        MergedPart(folder=part.path.name, shard=record.shard, resumed=record.resumed, **dict(record.start()))
        for part, record in zip(parts, records, strict=True)
    )
    return records[0].model_copy(update={"shard": None, "resumed": (), "merged": merged})
