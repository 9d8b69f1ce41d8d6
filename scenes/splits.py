"""The splits of the suite: which scenes and seeds are for training, for validation and for testing.

`splits.json` lists them. A published version is never changed, so that results on a split stay comparable.
"""

import functools
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

_FILE = Path(__file__).with_name("splits.json")
HELD_BACK = "held-back"
"""The split whose seeds are derived from a key that its publisher keeps. `splits()` omits it, because without the key
it has no seeds."""


@dataclass(frozen=True, slots=True)
class Split:
    """A part of the suite."""

    name: str
    scenes: tuple[int, ...]
    """Ids of its scenes."""
    seeds: range
    """Seeds of its variants of each scene."""
    version: int
    """Version of `splits.json` that the split was taken from."""

    @property
    def label(self) -> str:
        """Name and version, as records hold them, such as `test@1`."""
        return f"{self.name}@{self.version}"


@functools.cache
def splits() -> Mapping[str, Split]:
    """Return the splits by name.

    `train` and `validation` share scenes, with different seeds; `validation` also has scenes whose main idea `train`
    lacks. `test-seeds` has the scenes of `train`. The ideas and categories of `test-ideas` and `test-categories` occur
    in neither `train` nor `validation`. `test` has the scenes of all these splits. `test-open` has the open worlds.
    """
    listed: dict[str, Any] = json.loads(_FILE.read_text(encoding="utf-8"))
    train, validation = tuple(listed["train"]), _united(listed["validation_ideas"])
    ideas, categories = _united(listed["test_ideas"]), _united(listed["test_categories"])
    seeds = {name: range(first, last + 1) for name, (first, last) in listed["seeds"].items()}
    parts = {
        "train": (train, "train"),
        "validation": (train + validation, "validation"),
        "test": (train + validation + ideas + categories, "test"),
        "test-seeds": (train, "test"),
        "test-ideas": (ideas, "test"),
        "test-categories": (categories, "test"),
        "test-open": (tuple(listed["open"]), "test"),
    }
    return {
        name: Split(name, tuple(sorted(scenes)), seeds[drawn], listed["version"])
        for name, (scenes, drawn) in parts.items()
    }


def _united(groups: Mapping[str, list[int]]) -> tuple[int, ...]:
    return tuple(scene for group in groups.values() for scene in group)
