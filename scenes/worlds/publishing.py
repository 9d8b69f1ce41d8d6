"""Writes a published set of worlds: records and, in a separate folder, certificates, both with the suite's canary."""

import tempfile
from pathlib import Path

from scenes.errors import WorldError
from scenes.worlds.folders import find_certificate, worlds_of
from scenes.worlds.levels import LEVELS
from scenes.worlds.records import CANARY_LINE, Certificate, WorldRecord, as_line, lines_file

MOST_BYTES = 2_000_000
"""Largest size of the records and certificates of a published set [bytes]."""


def publish(source: Path, target: Path, count: int) -> dict[str, int]:
    """Write the first worlds of each level in a folder as a published set.

    Args:
        source: A folder of worlds, as `worlds make` writes it.
        target: The folder to create.
        count: Number of worlds of each level.

    Returns:
        Name of each file in `target` → its size [bytes].

    Raises:
        WorldError: A world is missing, is held-back, has other settings or no matching certificate, the set is too
            large, or the folder cannot be written.
    """
    levels = [level for level in LEVELS if lines_file(source, level).exists()]
    if not levels:
        raise WorldError(f"{source} holds no worlds; `physment-eval worlds make` makes them")
    texts: dict[str, str] = {}
    for level in levels:
        worlds = [_publishable(source, level, index) for index in range(count)]
        texts[f"level-{level}.jsonl"] = _text([record for record, _ in worlds])
        texts[f"keys/level-{level}.keys.jsonl"] = _text([certificate for _, certificate in worlds])
    size = sum(len(text.encode()) for text in texts.values())
    if size > MOST_BYTES:
        raise WorldError(f"these worlds take {size:,} bytes, and a published set may take {MOST_BYTES:,}")
    _write(target, texts)
    return {name: len(text.encode()) for name, text in texts.items()}


def _publishable(source: Path, level: int, index: int) -> tuple[WorldRecord, Certificate]:
    record = next((one for one in worlds_of(source, level) if one.index == index), None)
    name = f"world:{level}:{index}"
    if record is None:
        raise WorldError(f"{source} has no {name}, and a published set has no gaps")
    if record.commitment:
        raise WorldError(f"{name} was drawn with a key, so it is held back and not to be published")
    if record.settings:
        raise WorldError(f"{name} was made with {', '.join(record.settings)}, and not with the settings of its level")
    certificate = find_certificate(record, source)
    if certificate is None or certificate.record != record.digest:
        raise WorldError(f"{name} has no certificate of its own")
    return record, certificate


def _text(lines: list[WorldRecord] | list[Certificate]) -> str:
    return CANARY_LINE + "".join(f"{as_line(line)}\n" for line in lines)


def _write(target: Path, texts: dict[str, str]) -> None:
    """Write all files, or none of them."""
    try:
        if target.exists() and any(target.iterdir()):
            raise WorldError(f"{target} is not empty; name a new folder")
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{target.name}-", dir=target.parent) as place:
            folder = Path(place) / "set"
            for name, text in texts.items():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                (folder / name).write_text(text, encoding="utf-8")
            if target.exists():
                target.rmdir()
            folder.rename(target)
    except OSError as error:
        raise WorldError(f"{target} cannot be written: {error.strerror}") from error
