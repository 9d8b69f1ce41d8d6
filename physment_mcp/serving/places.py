"""The places of episodes: how many are taken, in one process or in all workers of a host together."""

from dataclasses import dataclass, field
from mmap import mmap


def shared_memory(file: int, workers: int) -> "memoryview[int]":
    """The memory of a file in which each worker counts the places that it has taken.

    Args:
        file: Descriptor of a file that all workers have inherited.
        workers: How many there are.
    """
    return memoryview(mmap(file, workers * 8)).cast("q")


def _own_memory() -> "memoryview[int]":
    return memoryview(bytearray(8)).cast("q")


@dataclass(slots=True)
class Places:
    """Counts taken places. No lock is needed: each worker writes its own number, and first takes, then looks."""

    most: int
    _taken: "memoryview[int]" = field(default_factory=_own_memory)
    """Worker → places that it has taken."""
    _worker: int = 0

    @property
    def taken(self) -> int:
        """Places that all workers have taken."""
        return sum(self._taken)

    def take(self) -> bool:
        """Take a place; returns False, and takes none, if there is none left."""
        self._taken[self._worker] += 1
        if self.taken <= self.most:
            return True
        self.leave()
        return False

    def leave(self) -> None:
        """Give a place back."""
        self._taken[self._worker] -= 1
