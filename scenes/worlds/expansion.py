"""Generates packs from records of worlds, in a cache on disk.

With a certificate, the pack is complete. Without a certificate, it contains only the public half and the model, as an
exported pack does.
"""

import contextlib
import os
import tempfile
from pathlib import Path

from scenes.errors import PackError, WorldError
from scenes.folder import PackFiles
from scenes.public import PublicPack, exported_json, exported_mjcf
from scenes.world_names import place_of, reference_of
from scenes.worlds.folders import find_certificate, find_record, find_worlds
from scenes.worlds.packs import mjcf_of, pack_of
from scenes.worlds.records import Certificate, WorldRecord, as_line
from scenes.worlds.reference import SOLUTION


def expand(record: WorldRecord, folder: Path, certificate: Certificate | None = None) -> PackFiles:
    """Write the pack of a world into the cache folder, unless it exists.

    Args:
        record: The world.
        folder: Cache folder of packs of worlds.
        certificate: Certificate of the world, which contains the answer key. None for a laboratory on another machine,
            which must not receive the key.

    Raises:
        WorldError: The folder cannot be written, or the certificate belongs to another record.
    """
    if certificate is not None and certificate.record != record.digest:
        raise WorldError(f"the certificate of world {record.level}:{record.index} is that of another record")
    files = PackFiles(record.scene_id, folder / f"Scene{record.scene_id}")
    pack = pack_of(record, certificate)
    model = mjcf_of(record)
    if certificate is None:
        public = PublicPack.of(files.scene_id, pack).model_dump_json(by_alias=True)
        texts = {exported_json(files): public, exported_mjcf(files, 0): model}
    else:
        solution = SOLUTION.format(reference=reference_of(files.scene_id), line=as_line(record))
        texts = {files.json: pack.model_dump_json(by_alias=True), files.mjcf: model, files.solution: solution}
    try:
        files.folder.mkdir(parents=True, exist_ok=True)
        for path, text in texts.items():
            _write_whole(path, text)
    except OSError as error:
        raise WorldError(f"{folder} cannot keep the packs of worlds: {error.strerror}") from error
    return files


def _write_whole(path: Path, text: str) -> None:
    """Write a file atomically, so that no other process reads a partial one."""
    written = text.encode()
    with contextlib.suppress(OSError):
        if path.read_bytes() == written:
            return
    descriptor, name = tempfile.mkstemp(dir=path.parent)
    try:
        with os.fdopen(descriptor, "wb") as file:
            file.write(written)
        Path(name).replace(path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def find_world(scene_id: int, folder: Path) -> PackFiles:
    """Return the pack of a world, from the records in a folder of packs or worlds.

    Raises:
        PackError: There is no such world, or its pack cannot be written.
    """
    try:
        record = find_record(*place_of(scene_id), folder)
        certificate = find_certificate(record, folder)
        _cache().mkdir(mode=0o700, parents=True, exist_ok=True)  # packs contain answer keys
        kept = _cache() / f"{record.digest}-{certificate.digest if certificate else 'public'}"
        return expand(record, kept, certificate)
    except WorldError as error:
        raise PackError(folder, str(error)) from error


def world_ids(text: str, folder: Path) -> list[int]:
    """Return the scene ids of the worlds that a reference names.

    Raises:
        PackError: It is malformed, or one of the worlds does not exist.
    """
    try:
        return [record.scene_id for record in find_worlds(text, folder)]
    except WorldError as error:
        raise PackError(folder, str(error)) from error


def _cache() -> Path:
    """The cache folder of packs of worlds. Source: the XDG Base Directory Specification."""
    home = os.environ.get("XDG_CACHE_HOME")
    return (Path(home) if home else Path.home() / ".cache") / "physment" / "worlds"
