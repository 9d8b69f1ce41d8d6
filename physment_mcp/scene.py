"""A scene as the laboratory sees it: the public half of its pack, and the model with the drawn values.

`scenes.public` copies the public fields one by one, so a private field that is added to packs later stays private.
"""

import functools
import hashlib
import logging
from dataclasses import dataclass, field
from pathlib import Path

from physment_mcp.errors import SceneError
from scenes import PackError, PackFiles, PublicPack, find_pack, hosted_files, list_packs, read_hosted, read_public

logger = logging.getLogger(__name__)

_KEPT = 256
"""Most scenes that a process keeps to open them again, each at one seed [about 12 kB each]."""


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Scene:
    """A scene at one seed: the public half of its pack, and its model with the drawn values.

    Its episodes share it, so nothing may change it. It is equal to itself alone, as the key of what is kept for it.
    """

    public: PublicPack
    mjcf: str = field(repr=False)
    """For the world alone: it contains the hidden values."""
    timestep: float | None = None
    """Time step that replaces the one of the model [s]."""


def load_scene(scene_id: int, seed: int = 0, folder: Path | None = None, timestep: float | None = None) -> Scene:
    """Read the public half of a scene and draw its hidden values. A scene that was loaded lately is the same object.

    Args:
        scene_id: Id of the scene, 7 to 111 in the suite.
        seed: 0 for the scene as written, any other whole number for a variant of it.
        folder: Folder of packs, whole or exported; the installed suite by default.
        timestep: Time step that replaces the one of the model [s].

    Raises:
        SceneError: There is no such scene, or its pack is malformed or outside the folder.
    """
    try:
        files = find_pack(scene_id, folder)
    except PackError as error:
        raise SceneError(str(error), for_client=error.problem) from error
    try:
        written = tuple(_digest(path) for path in hosted_files(files, seed))
        return _drawn(files, seed, timestep, written)
    except PackError as error:
        raise SceneError(str(error)) from error


@functools.lru_cache(_KEPT)
def _drawn(files: PackFiles, seed: int, timestep: float | None, _written: tuple[bytes, ...]) -> Scene:
    """The scene of a pack; `_written` tells apart the contents that the files of one path have in turn."""
    return Scene(*read_hosted(files, seed), timestep)


def _digest(path: Path) -> bytes:
    """What stands for the content of a file; empty for one that cannot be read, of which the reader will complain."""
    try:
        return hashlib.sha256(path.read_bytes()).digest()
    except OSError:
        return b""


def load_variants(scene_id: int, folder: Path | None = None) -> list[str]:
    """The models of a scene at seeds 0 to 19.

    Twenty are enough to see what depends on the seed: a choice of two values is the same in all with a chance of 1 in
    500 000.

    Raises:
        SceneError: One of them cannot be read, for example because it was not exported.
    """
    try:
        files = find_pack(scene_id, folder)
        return [read_hosted(files, seed)[1] for seed in range(20)]
    except PackError as error:
        raise SceneError(f"frames need the seeds 0 to 19 of a scene: {error}") from error


def scene_ids(folder: Path | None = None) -> list[int]:
    """Ids of the scenes in a folder, ascending.

    Raises:
        SceneError: There is no such folder, or it holds no pack.
    """
    try:
        return [files.scene_id for files in list_packs(folder)]
    except PackError as error:
        raise SceneError(str(error)) from error


def list_scenes(folder: Path | None = None) -> list[PublicPack]:
    """The public halves of the packs in a folder, by ascending id; a pack that cannot be read is logged and left out.

    Raises:
        SceneError: There is no such folder, or it holds no pack.
    """
    found: list[PublicPack] = []
    for scene_id in scene_ids(folder):
        try:
            found.append(read_public(find_pack(scene_id, folder)))
        except PackError as error:
            logger.warning("scene %d is not listed: %s", scene_id, error)
    return found
