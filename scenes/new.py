"""Creates a new scene from a template with its id and category; the result passes `physment-eval lint`."""

import re
from importlib.resources import files as resources
from pathlib import Path

from scenes.errors import PackError
from scenes.pack import CANARY, Category

_SECOND_CONCEPT = re.compile(r'("concepts": \["[^"]*"), "[^"]*"\]')
"""The concepts of a template. A scene with a single concept keeps the first one."""
_FILES = (("scene.json", "scene{}.json"), ("scene.xml", "scene{}.xml"), ("solution.py", "solution.py"))


def write_new_scene(folder: Path, scene: int, category: Category) -> Path:
    """Write `Scene{N}` into a folder of packs; returns the folder of the new pack.

    Raises:
        PackError: The scene exists already, or the folder cannot be written.
    """
    target = folder / f"Scene{scene}"
    template = resources("scenes") / "templates" / _template(category)
    try:
        target.mkdir(parents=True)
        for source, name in _FILES:
            text = (template / source).read_text(encoding="utf-8")
            text = text.replace("SCENE_ID", str(scene)).replace("CATEGORY", category).replace("CANARY", CANARY)
            if "single" in category:
                text = _SECOND_CONCEPT.sub(r"\1]", text)
            (target / name.format(scene)).write_text(text, encoding="utf-8")
    except FileExistsError as error:
        raise PackError(target, "exists already; choose another id") from error
    except OSError as error:
        raise PackError(target, f"cannot be written: {error.strerror}") from error
    return target


def _template(category: Category) -> str:
    if category.endswith("hidden"):
        return "hidden"
    if category in {Category.HARD_SINGLE, Category.HARD_MULTI, Category.OPEN}:
        return "prediction"
    made = category.endswith("creation") or category is Category.CREATE_DELETE_ATTACH
    return "creation" if made else "plain"
