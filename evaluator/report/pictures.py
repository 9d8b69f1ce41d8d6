"""Thumbnails of scenes, taken from the documentation; for notebooks only if they show the packs that were played."""

from collections.abc import Mapping, Sequence
from pathlib import Path

from scenes import PackFiles, default_folder, list_packs, same_pack


def pictures(played: Mapping[str, str], scenes_dir: Path | None = None) -> dict[int, bytes]:
    """Scene → PNG, for the scenes of a run whose packs have the same content as the packs in the folder.

    Args:
        played: Scene → hash of the pack that was played.
        scenes_dir: Folder of packs; the suite's own if None.
    """
    if not pictures_folder(scenes_dir).is_dir():
        return {}
    packs = [files for files in list_packs(scenes_dir) if str(files.scene_id) in played]
    return thumbnails([files for files in packs if same_pack(played[str(files.scene_id)], files)], scenes_dir)


def thumbnails(packs: Sequence[PackFiles], scenes_dir: Path | None = None) -> dict[int, bytes]:
    """Scene → PNG, for those of the packs that have one."""
    folder = pictures_folder(scenes_dir) / "small"
    stored = {files.scene_id: folder / f"scene{files.scene_id}.png" for files in packs}
    return {scene: path.read_bytes() for scene, path in stored.items() if path.is_file()}


def pictures_folder(scenes_dir: Path | None = None) -> Path:
    """Where the pictures of scenes are: `docs/reference/scenes`, beside the folder of packs.

    An installed package has no such folder; a report is complete without pictures.
    """
    return (scenes_dir or default_folder()).resolve().parent / "docs" / "reference" / "scenes"
