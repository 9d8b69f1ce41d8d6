"""Specifies which worlds to make: level, attributes, key and split. Makes no worlds."""

import hashlib
import itertools
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import cast

from scenes.errors import WorldError
from scenes.splits import HELD_BACK
from scenes.world_names import LEVEL_IDS
from scenes.worlds.levels import Difficulty, difficulty_of
from scenes.worlds.records import lines_file, read_records

PUBLIC = "public"
"""Constant text that replaces the key for the public worlds."""
_SPLITS = ("train",) * 6 + ("validation",) * 2 + ("test",) * 2
"""Splits of ten consecutive indexes of the public worlds."""


@dataclass(frozen=True, slots=True)
class WorldOrder:
    """A specification of worlds of one level."""

    level: int
    difficulty: Difficulty
    secret: str
    """`PUBLIC`, or the text of a key. Without the key, the worlds cannot be predicted."""

    def split_at(self, index: int) -> str:
        """Return the split of the structure at an index; `held-back` for all worlds of a key."""
        return _SPLITS[index % len(_SPLITS)] if self.secret == PUBLIC else HELD_BACK

    @property
    def settings(self) -> tuple[str, ...]:
        """Return the attributes that differ from those of the level, by name, in the notation of `--set`."""
        usual = asdict(difficulty_of(self.level))
        changed = {name: value for name, value in sorted(asdict(self.difficulty).items()) if value != usual[name]}
        return tuple(
            f"{name}={','.join(map(str, cast('tuple[object]', value))) if isinstance(value, tuple) else value}"
            for name, value in changed.items()
        )

    @property
    def commitment(self) -> str:
        """Return a cryptographic commitment to the key; empty for the public worlds."""
        if self.secret == PUBLIC:
            return ""
        return hashlib.sha256(f"physment worlds 1: {self.secret}".encode()).hexdigest()

    def indexes(self, count: int, split: str | None = None, first: int = 0) -> list[int]:
        """Return `count` indexes of worlds from `first` on: consecutive ones, or the next ones of a split.

        Raises:
            WorldError: The split has fewer.
        """
        if split is not None and (split == HELD_BACK) != (self.secret != PUBLIC):
            raise WorldError(f"the worlds of a key are those of the split {HELD_BACK}, and no others are")
        fitting = (index for index in range(first, LEVEL_IDS) if split in {None, self.split_at(index)})
        found = list(itertools.islice(fitting, count))
        if len(found) < count:
            raise WorldError(
                f"a level has {len(found)} such worlds from {first} on, not {count}; another key has others"
            )
        return found

    def missing(self, wanted: Sequence[int], folder: Path) -> list[int]:
        """Return those of the wanted indexes for which a folder has no world.

        Raises:
            WorldError: The existing worlds cannot be read, or one of them has other settings.
        """
        lines = lines_file(folder, self.level)
        records = read_records(folder, self.level) if lines.exists() else ()
        there = {record.index: record for record in records}
        for record in (there[index] for index in wanted if index in there):
            if (record.settings, record.commitment) != (self.settings, self.commitment):
                made = f"with {', '.join(record.settings)}" if record.settings else "with the settings of the level"
                key = " by a key" if record.commitment else ""
                raise WorldError(
                    f"{lines} holds world:{self.level}:{record.index}, which was made {made}{key}; for others choose"
                    " another --out, or other indexes with --first"
                )
        return [index for index in wanted if index not in there]
