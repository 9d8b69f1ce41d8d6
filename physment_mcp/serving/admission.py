"""Opens episodes on a server: the request model, the quota of open episodes, and loading the scene.

Independent of HTTP, sockets and MCP.
"""

import logging
import os
from dataclasses import dataclass, field
from pathlib import Path

import anyio
import anyio.to_thread
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from physment_mcp.errors import NotOpened, SceneError, quoted
from physment_mcp.scene import kept_scene, load_scene
from physment_mcp.session import Session

logger = logging.getLogger(__name__)

_LARGEST = 2**64 - 1
"""Largest magnitude of an integer in a request. No scene id or seed is larger. Errors and logs quote the integer."""
EPISODE_BYTES = 1_000_000
"""Largest memory of an open episode: its state, a model of its own, its MCP server and its log.
`tests/harness/bench/opening.py` measures 0.6 MB where four episodes share a seed."""
_SHARE = 0.5
"""Share of the free memory that episodes may take."""
_MOST = 8000
"""Largest default quota: beyond it, the system's limit of open files is reached first."""
_UNKNOWN = 1000
"""Default quota where the free memory is unknown."""


class EpisodeRequest(BaseModel):
    """A request for an episode: the body of `POST /episodes`, or the first line on a socket."""

    model_config = ConfigDict(extra="forbid", strict=True)

    scene: int = Field(ge=-_LARGEST, le=_LARGEST)
    seed: int = Field(default=0, ge=-_LARGEST, le=_LARGEST)
    max_calls: int | None = Field(default=None, ge=1, le=10_000)
    """Limit on tool calls; the owner can then read the call log. None for no limit."""
    guarded: bool = False
    """Whether playing the episode requires a token of its own, which its URL does not contain."""


@dataclass(slots=True)
class EpisodeQuota:
    """Counts open episodes up to a limit."""

    most: int
    taken: int = 0

    def acquire(self) -> bool:
        """Reserve the capacity of one episode; returns False at the limit."""
        if self.taken == self.most:
            return False
        self.taken += 1
        return True

    def release(self) -> None:
        """Release the capacity of one episode."""
        self.taken -= 1


@dataclass(slots=True)
class Admission:
    """Opens sessions, up to a quota of open episodes."""

    scenes_dir: Path | None
    quota: EpisodeQuota
    """Quota of open episodes."""
    timestep: float | None
    """Time step that replaces those of the models [s]."""
    for_operator: bool
    """Whether error messages may contain details of packs: true if only the operator can send requests."""
    _loading: anyio.Semaphore = field(default_factory=lambda: anyio.Semaphore(1))
    """Held while a scene is loaded in a thread, which takes up to 50 ms."""

    async def open(self, body: bytes) -> tuple[EpisodeRequest, Session]:
        """Open a session. It counts towards the quota until the caller closes the episode and calls `quota.release`.

        Args:
            body: The request in JSON.

        Raises:
            NotOpened: The request is malformed, the quota is used up, or the scene cannot be loaded.
        """
        try:
            wanted = EpisodeRequest.model_validate_json(body or b"{}")
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            where = ".".join(str(part) for part in first["loc"]) or "body"
            raise NotOpened(400, f'{quoted(where)[1:-1]}: {first["msg"]}; send {{"scene": 7, "seed": 0}}') from error
        if not self.quota.acquire():
            raise NotOpened(429, f"{self.quota.most} episodes are open, which is the limit; delete some or wait")
        try:
            kept = kept_scene(wanted.scene, wanted.seed, self.scenes_dir, self.timestep)
            if kept is not None:
                return wanted, Session(kept, max_calls=wanted.max_calls)  # faster than starting a thread
            async with self._loading:
                return wanted, await anyio.to_thread.run_sync(self._load, wanted)
        except SceneError as error:
            self.quota.release()
            logger.warning("scene %d was asked for: %s", wanted.scene, error)
            raise NotOpened(404, str(error) if self.for_operator else error.for_client) from error
        except BaseException:
            self.quota.release()
            raise

    def _load(self, wanted: EpisodeRequest) -> Session:
        scene = load_scene(wanted.scene, wanted.seed, self.scenes_dir, self.timestep)
        return Session(scene, max_calls=wanted.max_calls)


def usual_episodes(free: int | None) -> int:
    """The default quota for an amount of free memory [bytes]; None if it is unknown."""
    return _UNKNOWN if free is None else min(_MOST, max(1, int(_SHARE * free / EPISODE_BYTES)))


def free_memory() -> int | None:
    """Memory that this process may still allocate [bytes]; None if unknown.

    Source: `MemAvailable` of Linux, and the limits of the control groups of this process; elsewhere half of all memory.
    """
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        free = next(1024 * int(line.split()[1]) for line in lines if line.startswith("MemAvailable:"))
    except (OSError, StopIteration):
        return _half_of_all()
    return min([free, *_left_in_groups(Path("/sys/fs/cgroup"), Path("/proc/self/cgroup"))])


def _left_in_groups(root: Path, membership: Path) -> list[int]:
    """Memory left in the control group of this process and in its ancestors, where they set a limit [bytes].

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
