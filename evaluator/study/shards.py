"""Shards: a stable hash divides a run among machines, so that each episode is played on exactly one of them."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass

from evaluator.errors import UsageError
from evaluator.records.episode import EpisodeKey

COUNT_VARIABLE = "PHYSMENT_SHARDS"
"""Environment variable with the number of shards, for schedulers that do not set it."""


@dataclass(frozen=True, slots=True)
class Shard:
    """One of several parts of a run."""

    index: int
    """From 1 to `count`."""
    count: int

    def takes(self, key: EpisodeKey) -> bool:
        """Whether an episode belongs to this part. The result is the same on every machine."""
        digest = hashlib.sha256(key.model_dump_json().encode()).digest()
        return int.from_bytes(digest[:8], "big") % self.count == self.index - 1

    @property
    def name(self) -> str:
        """Name of its folder in the folder of the run. Names sort in the order of the shards."""
        width = len(str(self.count))
        return f"shard-{self.index:0{width}}-of-{self.count}"


WHOLE = Shard(1, 1)


def parse_shard(text: str) -> Shard:
    """Read `i/n`.

    Raises:
        UsageError: These are not two whole numbers, the first from 1 to the second.
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
