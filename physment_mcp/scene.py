"""A scene as the laboratory uses it: the public half of its pack, and the model with the hidden values of a seed.

`scenes.public` copies the public fields one by one, so a private field that is added to packs later stays private.
"""

import functools
import hashlib
import logging
from collections import OrderedDict
from dataclasses import dataclass, field
from pathlib import Path
from threading import Lock
from typing import NamedTuple

from physment_mcp.errors import SceneError
from scenes import PackError, PackFiles, PublicPack, find_pack, hosted_files, list_packs, read_hosted, read_public

logger = logging.getLogger(__name__)

_KEPT = 256
"""Size of the cache of loaded scenes; an entry is a scene at one seed and takes about 12 kB."""
_KEPT_VARIANTS = 16
"""Number of scenes whose models at twenty seeds are cached."""


@dataclass(frozen=True, slots=True, weakref_slot=True)
class Scene:
    """A scene at one seed: the public half of its pack, and its model with the hidden values.

    Episodes share the object, so it must not be modified.
    """

    public: PublicPack
    mjcf: str = field(repr=False)
    """MuJoCo XML with the hidden values; only `World` may read it."""
    timestep: float | None = None
    """Time step that replaces the model's own [s]."""

    def __hash__(self) -> int:
        """Hash of the MJCF text only, because some public fields are not hashable."""
        return hash(self.mjcf)


class _Source(NamedTuple):
    """Cache key of a scene: its pack, hashes of the two files that it is loaded from, seed and time step."""

    files: PackFiles
    written: tuple[bytes, bytes]
    seed: int
    timestep: float | None


class _KeptScenes:
    """A cache of loaded scenes with least-recently-used eviction."""

    def __init__(self, most: int) -> None:
        self._most = most
        self._scenes: OrderedDict[_Source, Scene] = OrderedDict()
        self._lock = Lock()

    def get(self, source: _Source) -> Scene | None:
        """The scene, if it is in the cache."""
        with self._lock:
            scene = self._scenes.get(source)
            if scene is not None:
                self._scenes.move_to_end(source)
            return scene

    def keep(self, source: _Source, scene: Scene) -> Scene:
        """Add a scene, evict the least recently used one beyond the limit, and return the cached scene."""
        with self._lock:
            kept = self._scenes.setdefault(source, scene)
            if len(self._scenes) > self._most:
                self._scenes.popitem(last=False)
            return kept

    def clear(self) -> None:
        """Empty the cache."""
        with self._lock:
            self._scenes.clear()


_SCENES = _KeptScenes(_KEPT)


def load_scene(scene_id: int, seed: int = 0, folder: Path | None = None, timestep: float | None = None) -> Scene:
    """Read the public half of a scene and sample its hidden values. Loaded scenes are cached.

    Args:
        scene_id: Id of the scene, 7 to 111 in the suite.
        seed: 0 for the scene as written, any other whole number for a variant of it.
        folder: Folder of packs, whole or exported; the installed suite by default.
        timestep: Time step that replaces the model's own [s].

    Raises:
        SceneError: There is no such scene, or its pack is malformed or outside the folder.
    """
    source = _source(_pack(scene_id, folder), seed, timestep)
    scene = _SCENES.get(source)
    if scene is None:
        try:
            scene = _SCENES.keep(source, Scene(*read_hosted(source.files, seed), timestep))
        except PackError as error:
            raise SceneError(str(error)) from error
    return scene


def kept_scene(scene_id: int, seed: int = 0, folder: Path | None = None, timestep: float | None = None) -> Scene | None:
    """Return the scene from the cache; None if it is not cached, in which case `load_scene` takes milliseconds.

    Raises:
        SceneError: As for `load_scene`.
    """
    return _SCENES.get(_source(_pack(scene_id, folder), seed, timestep))


def _pack(scene_id: int, folder: Path | None) -> PackFiles:
    try:
        return find_pack(scene_id, folder)
    except PackError as error:
        raise SceneError(str(error), for_client=error.problem) from error


def _source(files: PackFiles, seed: int, timestep: float | None) -> _Source:
    try:
        description, model = hosted_files(files, seed)
    except PackError as error:
        raise SceneError(str(error)) from error
    return _Source(files, (_digest(description), _digest(model)), seed, timestep)


def _digest(path: Path) -> bytes:
    """Hash of a file's content; empty if it cannot be read. Loading the file then raises the error."""
    try:
        return hashlib.sha256(path.read_bytes()).digest()
    except OSError:
        return b""


def load_variants(scene_id: int, folder: Path | None = None) -> list[str]:
    """Return the models of a scene at seeds 0 to 19, as MuJoCo XML. They are cached, as scenes are.

    Comparing them shows which parts of the model depend on the seed. The probability that a random choice between two
    values is equal at all twenty seeds is 1 in 500 000.

    Raises:
        SceneError: One of them cannot be read, for example because it was not exported.
    """
    try:
        files = _pack(scene_id, folder)
        return list(_variants(tuple(_source(files, seed, None) for seed in range(20))))
    except (PackError, SceneError) as error:
        raise SceneError(f"frames need the seeds 0 to 19 of a scene: {error}") from error


@functools.lru_cache(_KEPT_VARIANTS)
def _variants(sources: tuple[_Source, ...]) -> tuple[str, ...]:
    """Return the models of sources. They have their own cache: that of `load_scene` seldom contains these seeds."""
    return tuple(read_hosted(source.files, source.seed)[1] for source in sources)


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
    """Return the public halves of the packs in a folder, by ascending id. Unreadable packs are logged and omitted.

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
