"""Opening episodes on a host: what a request must say, how many may be open, and loading the scene.

Knows no HTTP, no sockets and no MCP.
"""

import logging
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
"""Largest magnitude of a whole number: a larger one is no scene and no seed, and errors and logs would repeat it."""


class EpisodeRequest(BaseModel):
    """A request for an episode: the body of `POST /episodes`, or the first line on a socket."""

    model_config = ConfigDict(extra="forbid", strict=True)

    scene: int = Field(ge=-_LARGEST, le=_LARGEST)
    seed: int = Field(default=0, ge=-_LARGEST, le=_LARGEST)
    max_calls: int | None = Field(default=None, ge=1, le=10_000)
    """Tool calls that the episode may use, whose log its owner can read; None for no limit."""
    guarded: bool = False
    """Whether the episode is played only with a token of its own, which its URL does not contain."""


@dataclass(slots=True)
class EpisodeQuota:
    """Counts open episodes up to a limit."""

    most: int
    taken: int = 0

    def acquire(self) -> bool:
        """Count one more; returns False, and counts none, at the limit."""
        if self.taken == self.most:
            return False
        self.taken += 1
        return True

    def release(self) -> None:
        """Count one less."""
        self.taken -= 1


@dataclass(slots=True)
class Admission:
    """Opens sessions up to a quota."""

    scenes_dir: Path | None
    quota: EpisodeQuota
    """Of the episodes that may be open."""
    timestep: float | None
    """Time step that replaces those of the models [s]."""
    for_operator: bool
    """Whether refusals may tell details of packs: true if only the operator can ask."""
    _loading: anyio.Semaphore = field(default_factory=lambda: anyio.Semaphore(1))
    """Held while a scene is loaded, in a thread, because that takes up to 50 ms."""

    async def open(self, body: bytes) -> tuple[EpisodeRequest, Session]:
        """Open a session, which counts towards the quota until whoever closes the episode calls `quota.release`.

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
                return wanted, Session(kept, max_calls=wanted.max_calls)  # takes less time than a thread
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
