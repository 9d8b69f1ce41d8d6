"""A builder of scenes with deliberate faults."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from scenes import Category, PackFiles, find_pack, write_new_scene

TEMPLATE_SEEDS = 3
"""Number of seeds, from 0 on, at which the template of Hard scenes draws each of its three structures once."""


class Author:
    """Writes a valid scene from the template and introduces a fault into it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def write(self, category: Category) -> PackFiles:
        write_new_scene(self.folder, 200, category)
        return find_pack(200, self.folder)

    def edit(self, files: PackFiles, change: Callable[[dict[str, Any]], None]) -> None:
        pack = json.loads(files.json.read_text(encoding="utf-8"))
        change(pack)
        files.json.write_text(json.dumps(pack), encoding="utf-8")

    def replace(self, file: Path, old: str, new: str) -> None:
        text = file.read_text(encoding="utf-8")
        assert old in text
        file.write_text(text.replace(old, new), encoding="utf-8")
