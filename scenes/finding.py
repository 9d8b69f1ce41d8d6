"""Finds the files of a scene by its id: a pack in a folder, or a pack generated from the record of a world."""

from pathlib import Path

from scenes.draw import draw_knobs
from scenes.errors import PackError, WorldError
from scenes.folder import PackFiles, default_folder, listed_pack, read_pack
from scenes.model import drawn_mjcf
from scenes.splits import Split
from scenes.world_names import is_world, place_of, reference_of


def find_pack(scene_id: int, folder: Path | None = None) -> PackFiles:
    """Return the pack with this id.

    Args:
        scene_id: The number of a scene, or that of a world.
        folder: Folder of packs and worlds; the suite by default.

    Raises:
        PackError: There is no such pack; the message lists the ids of all packs.
    """
    folder = folder or default_folder()
    if not is_world(scene_id) or (folder / f"Scene{scene_id}").is_dir():  # an exported world is stored as a pack
        return listed_pack(scene_id, folder)
    try:
        from scenes.worlds.expansion import find_world  # noqa: PLC0415 - it loads numpy and scipy, which takes 0.3 s
    except ModuleNotFoundError as error:  # as in the bundle for Claude Desktop
        raise PackError(folder, f"{reference_of(scene_id)}: worlds are not installed here") from error
    return find_world(scene_id, folder)


def is_in_split(scene_id: int, split: Split, folder: Path | None = None) -> bool:
    """Return whether a scene belongs to a split. A world belongs to the split of its structure.

    Raises:
        PackError: There is no record of the world.
    """
    if not is_world(scene_id):
        return scene_id in split.scenes
    from scenes.worlds.folders import find_record  # noqa: PLC0415 - it loads numpy and scipy

    folder = folder or default_folder()
    try:
        return find_record(*place_of(scene_id), folder).split == split.name
    except WorldError as error:
        raise PackError(folder, str(error)) from error


def model_without_walls(scene_id: int, seed: int, folder: Path | None = None) -> str:
    """Return the model of a scene with its laws at a seed, without the wall if the scene is a world.

    Raises:
        PackError: There is no such pack, or it is malformed.
    """
    files = find_pack(scene_id, folder)
    if not is_world(scene_id):
        pack = read_pack(files)
        return drawn_mjcf(files, pack, draw_knobs(files, pack, seed), canonical=seed == 0)
    from scenes.worlds.folders import find_record  # noqa: PLC0415 - it loads numpy and scipy
    from scenes.worlds.packs import mjcf_of  # noqa: PLC0415 - as above

    try:
        record = find_record(*place_of(scene_id), folder or default_folder())
    except WorldError as error:
        raise PackError(files.folder, str(error)) from error
    return mjcf_of(record, walled=False, padded=False)
