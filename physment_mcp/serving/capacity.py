"""How many episodes a host can hold: from the memory that is free when it starts. Knows no episodes."""

import os
from pathlib import Path

EPISODE_BYTES = 1_000_000
"""What an open episode takes at most: its state, a model of its own, its server and its log.
`tests/harness/bench/opening.py` measures 0.6 MB where four episodes share a seed."""
_SHARE = 0.5
"""Share of the free memory that episodes may take."""
_MOST = 8000
"""Most episodes by default: beyond this the system's limit of open connections is the nearer one."""
_UNKNOWN = 1000
"""Episodes by default where the system does not tell how much memory is free."""


def usual_episodes(free: int | None) -> int:
    """How many episodes a host takes if nobody says so, for some free memory [bytes], None if that is unknown."""
    return _UNKNOWN if free is None else min(_MOST, max(1, int(_SHARE * free / EPISODE_BYTES)))


def free_memory() -> int | None:
    """Memory that this process may still take [bytes]; None if the system does not tell.

    Source: `MemAvailable` of Linux, and the limits of the control groups of this process; elsewhere half of all memory.
    """
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        free = next(1024 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:"))
    except (OSError, StopIteration):
        return _half_of_all()
    return min([free, *_left_in_groups(Path("/sys/fs/cgroup"), Path("/proc/self/cgroup"))])


def _left_in_groups(root: Path, membership: Path) -> list[int]:
    """What the control group of this process and those above it still allow [bytes], where they set a limit.

    Source: `memory.max` and `memory.current` of control groups, version 2.
    """
    try:
        (group,) = (line[len("0::/") :] for line in membership.read_text().splitlines() if line.startswith("0::/"))
    except (OSError, ValueError):
        return []
    own = root / group.strip("/")
    left: list[int] = []
    for folder in (own, *own.parents):
        if not folder.is_relative_to(root):
            break
        try:
            most, used = ((folder / name).read_text().strip() for name in ("memory.max", "memory.current"))
        except OSError:
            continue
        if most != "max":
            left.append(max(0, int(most) - int(used)))
    return left


def _half_of_all() -> int | None:
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // 2
    except (AttributeError, OSError, ValueError):
        return None  # as on Windows
