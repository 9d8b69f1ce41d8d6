"""Exports packs without their private halves, for a host on another machine that must not have the answers."""

import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Collection
from pathlib import Path

from scenes.draw import draw_knobs
from scenes.errors import PackError
from scenes.finding import find_pack
from scenes.folder import PackFiles, list_packs, read_pack
from scenes.model import drawn_mjcf, noise_of_seed
from scenes.public import PublicPack, exported_json, exported_mjcf


def export_packs(target: Path, seeds: Collection[int], ids: Collection[int] = (), source: Path | None = None) -> int:
    """Write packs without their private halves: all of them, or nothing if one fails.

    Args:
        target: Folder to create; it may exist if it is empty.
        seeds: The variants whose models are written.
        ids: Ids of the scenes; all by default.
        source: Folder of whole packs; the suite by default.

    Returns:
        The number of packs written.

    Raises:
        PackError: A pack is missing or malformed, or the target is in use.
    """
    packs = [find_pack(scene_id, source) for scene_id in ids] or list_packs(source)
    if target.exists():
        if not target.is_dir():
            raise PackError(target, "is not a folder")
        if any(target.iterdir()):
            raise PackError(target, "is not empty; name a new folder")
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{target.name}-", dir=target.parent) as place:
        folder = Path(place) / "packs"
        for files in packs:
            _export(files, seeds, folder)
        if target.exists():
            target.rmdir()
        folder.rename(target)
    return len(packs)


def _export(files: PackFiles, seeds: Collection[int], folder: Path) -> None:
    pack = read_pack(files)
    copy = PackFiles(files.scene_id, folder / f"Scene{files.scene_id}")
    copy.folder.mkdir(parents=True)
    public = PublicPack.of(files.scene_id, pack).model_dump_json(indent=1)
    exported_json(copy).write_text(public + "\n", encoding="utf-8")
    for seed in seeds:
        drawn = noise_of_seed(drawn_mjcf(files, pack, draw_knobs(files, pack, seed), canonical=seed == 0), seed)
        exported_mjcf(copy, seed).write_text(_without_comments(files, drawn), encoding="utf-8")


def _without_comments(files: PackFiles, mjcf: str) -> str:
    # The author's comments explain the physics, so they are private; the parser drops them.
    try:
        return ET.tostring(ET.fromstring(mjcf), encoding="unicode") + "\n"  # noqa: S314 - packs the operator named
    except ET.ParseError as error:
        raise PackError(files.mjcf, f"not XML: {error}") from error
