"""The folder of packs: `{folder}/Scene{N}/scene{N}.json`, `scene{N}.xml` and, optionally, `solution.py`."""

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pydantic import ValidationError

from scenes.errors import PackError
from scenes.pack import Pack

_PACK_FOLDER = re.compile(r"Scene(\d+)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class PackFiles:
    """The files of a pack."""

    scene_id: int
    folder: Path

    @property
    def json(self) -> Path:
        """Path of the metadata, permissions, answer and knobs."""
        return self.folder / f"scene{self.scene_id}.json"

    @property
    def mjcf(self) -> Path:
        """Path of the MuJoCo model at seed 0."""
        return self.folder / f"scene{self.scene_id}.xml"

    @property
    def solution(self) -> Path:
        """Path of the reference protocol and the formulas of the answer; packs of the prototype lack this file."""
        return self.folder / "solution.py"

    def check_inside(self, *files: Path) -> None:
        """Raise if a file is a symbolic link that leads out of the folder of packs.

        A client chooses the scene id and must not be able to make the laboratory read another file.

        Raises:
            PackError: A file is outside the folder.
        """
        root = self.folder.parent.resolve()
        for path in files:
            if not path.resolve().is_relative_to(root):
                raise PackError(path, "a link leads out of the folder of scene packs")


def default_folder() -> Path:
    """The folder of the suite that is installed with this package."""
    return Path(__file__).parent


def list_packs(folder: Path | None = None) -> list[PackFiles]:
    """Return all packs in `folder` (default: the suite), by ascending id; empty for a folder with only worlds.

    Raises:
        PackError: The folder does not exist, or contains neither packs nor worlds.
    """
    folder = folder or default_folder()
    if not folder.is_dir():
        raise PackError(folder, "no such folder of scene packs")
    found = [
        PackFiles(int(match[1]), path)
        for path in folder.iterdir()
        if path.is_dir() and (match := _PACK_FOLDER.fullmatch(path.name))
    ]
    if not found and not any(folder.glob("level-*.jsonl")) and not (folder / "worlds").is_dir():
        raise PackError(folder, "holds no scene packs (folders named Scene7, Scene8, …)")
    return sorted(found, key=lambda files: files.scene_id)


def listed_pack(scene_id: int, folder: Path | None = None) -> PackFiles:
    """The pack with this id among those in a folder.

    Raises:
        PackError: There is no such pack; the message lists the ids of all packs.
    """
    # Try the usual name first: a host opens many episodes a second, and a listing reads every folder.
    usual = PackFiles(scene_id, (folder or default_folder()) / f"Scene{scene_id}")
    if usual.folder.is_dir():
        return usual
    packs = list_packs(folder)
    for files in packs:
        if files.scene_id == scene_id:
            return files
    known = ranges([files.scene_id for files in packs])
    raise PackError(folder or default_folder(), f"no scene {scene_id}; the scenes here are {known}")


def ranges(numbers: Sequence[int]) -> str:
    """Format ascending numbers as text, such as `0-20, 40`."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1] = [runs[-1][0], number]
        else:
            runs.append([number])
    return ", ".join("-".join(map(str, run)) for run in runs) or "none"


def read_pack(files: PackFiles) -> Pack:
    """Parse and validate the JSON of a pack.

    Raises:
        PackError: The file is missing, is not UTF-8 JSON, or a field is wrong; the message names the field.
    """
    try:
        raw = json.loads(files.json.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        if (files.folder / f"scene{files.scene_id}.public.json").is_file():
            raise PackError(files.folder, "exported without its private half, so it can only be played") from error
        raise PackError(files.json, "no such file") from error
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise PackError(files.json, f"not JSON in UTF-8: {error}") from error
    try:
        return Pack.model_validate(raw)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        field = ".".join(str(part) for part in first["loc"]) or "(the whole file)"
        raise PackError(files.json, f"field {field}: {first['msg']}") from error
