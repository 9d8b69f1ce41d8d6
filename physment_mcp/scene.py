"""A scene as the laboratory sees it: the public half of its pack, and the model with the drawn values.

`scenes.public` copies the public fields one by one, so a private field that is added to packs later stays private.
"""

import logging
from dataclasses import dataclass, field
from pathlib import Path

from physment_mcp.errors import SceneError
from scenes import PackError, PublicPack, find_pack, list_packs, read_hosted, read_public

logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Scene:
    """A scene at one seed: the public half of its pack, and its model with the drawn values."""

    public: PublicPack
    mjcf: str = field(repr=False)
    """For the world alone: it contains the hidden values."""
    timestep: float | None = None
    """Time step that replaces the one of the model [s]."""


def load_scene(scene_id: int, seed: int = 0, folder: Path | None = None, timestep: float | None = None) -> Scene:
    """Read the public half of a scene and draw its hidden values.

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
        public, mjcf = read_hosted(files, seed)
    except PackError as error:
        raise SceneError(str(error)) from error
    return Scene(public, mjcf, timestep)


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
