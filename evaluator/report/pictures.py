"""Pictures of scenes for notebooks, taken from the documentation if they show the packs that were played."""

from collections.abc import Mapping
from pathlib import Path

from scenes import default_folder, list_packs, same_pack


def pictures(played: Mapping[str, str], scenes_dir: Path | None = None) -> dict[int, bytes]:
    """Scene → PNG, for the scenes of a run whose packs have the same content as the packs in the folder.

    The pictures are in `docs/reference/scenes`, beside the folder of packs. An installed package has no pictures; a
    report is complete without them.

    Args:
        played: Scene → hash of the pack that was played.
        scenes_dir: Folder of packs; the suite's own if None.
    """
    kept = (scenes_dir or default_folder()).resolve().parent / "docs" / "reference" / "scenes"
    if not kept.is_dir():
        return {}
    found: dict[int, bytes] = {}
    for files in list_packs(scenes_dir):
        scene, picture = str(files.scene_id), kept / f"scene{files.scene_id}.png"
        if scene in played and picture.is_file() and same_pack(played[scene], files):
            found[files.scene_id] = picture.read_bytes()
    return found
