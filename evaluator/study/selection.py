"""Reads the values of `--scenes`, `--budgets`, `--seeds` and `--split`."""

from pathlib import Path
from typing import NamedTuple

from evaluator.errors import UsageError
from scenes import Category, PackError, PackFiles, Rung, default_folder, find_pack, is_world, list_packs, read_pack
from scenes.finding import is_in_split
from scenes.folder import ranges
from scenes.splits import HELD_BACK, Split, splits

SUITE = "all"
"""Selects every scene except the open worlds, which are a separate track."""
USUAL_SEEDS = 20
"""Default number of seeds of a split. A split of open worlds alone is played at one seed."""


class Selected(NamedTuple):
    """The selected scenes and seeds."""

    split: str
    """Name and version of the split; empty if none is named."""
    packs: tuple[PackFiles, ...]
    seeds: tuple[int, ...]


def select(
    split: str | None = None, scenes: str | None = None, seeds: str | None = None, scenes_dir: Path | None = None
) -> Selected:
    """Select scenes and seeds; by default the suite at seed 0.

    Args:
        split: Name of a split; `scenes` and `seeds` then select from it.
        scenes: Ids, ranges, rungs and categories, such as `7,9,20-30`, `easy` or `category:easy-single`.
        seeds: Numbers and ranges, such as `0,3-5`; by default the first twenty seeds of a split.
        scenes_dir: Folder of scene packs; the suite by default.

    Raises:
        UsageError: An argument is malformed, selects nothing or contradicts another one.
    """
    if split is None:
        return Selected("", tuple(parse_scenes(scenes or SUITE, scenes_dir)), parse_numbers(seeds or "0", "--seeds", 0))
    found = find_split(split)
    packs = scenes_in_split(found, scenes, scenes_dir)
    usual = USUAL_SEEDS if any(not is_world(files.scene_id) for files in packs) else 1
    return Selected(found.label, tuple(packs), seeds_in_split(found, seeds, usual))


def parse_scenes(text: str | None, scenes_dir: Path | None) -> list[PackFiles]:
    """Return the packs that `--scenes` selects: ids, ranges, rungs, categories, worlds and `all`, comma-separated.

    A range selects the existing scenes in it. A single id must exist. None selects every pack, including open worlds.

    Raises:
        UsageError: A part is malformed or selects nothing.
    """
    parts = [part.strip() for part in (text or "").split(",")]
    worlds = [part for part in parts if part.startswith("world:")]
    try:
        found_worlds = list({files.scene_id: files for part in worlds for files in _worlds(part, scenes_dir)}.values())
        if worlds and len(worlds) == len(parts):
            return found_worlds
        packs = {files.scene_id: files for files in list_packs(scenes_dir)}
        if text is None:
            return list(packs.values())
        chosen: set[int] = set()
        for part in (part for part in parts if part not in worlds):
            found = _select(part, packs)
            if not found:
                raise UsageError(f"--scenes {part}: there is no such scene; the scenes are {ranges(sorted(packs))}")
            chosen |= found
    except PackError as error:
        raise UsageError(str(error)) from error
    return [packs[scene] for scene in sorted(chosen)] + found_worlds


def _worlds(part: str, scenes_dir: Path | None) -> list[PackFiles]:
    from scenes.worlds.expansion import world_ids  # noqa: PLC0415 - it loads numpy and scipy

    return [find_pack(scene, scenes_dir) for scene in world_ids(part, scenes_dir or default_folder())]


def find_split(name: str) -> Split:
    """Find a split of the suite by name.

    Raises:
        UsageError: There is no such split, or only its publisher knows its seeds.
    """
    if name == HELD_BACK:
        raise UsageError(f"the seeds of {HELD_BACK} come from a key that its publisher keeps: run --seed-key FILE")
    if name not in splits():
        raise UsageError(f"there is no split {name!r}; the splits are {', '.join(splits())} and {HELD_BACK}")
    return splits()[name]


def scenes_in_split(split: Split, scenes: str | None, scenes_dir: Path | None) -> list[PackFiles]:
    """Return the packs of a split, or those of them that `--scenes` selects.

    Raises:
        UsageError: A part is malformed, or the split has none of these scenes.
    """
    named = parse_scenes(scenes, scenes_dir)
    try:
        packs = [files for files in named if is_in_split(files.scene_id, split, scenes_dir)]
    except PackError as error:
        raise UsageError(str(error)) from error
    if not packs and named and is_world(named[0].scene_id):
        raise UsageError(
            f"the split {split.name} has none of the worlds --scenes {scenes}: their structures are in others"
        )
    if not packs:
        where = f"--scenes {scenes}" if scenes else f"{scenes_dir}"
        raise UsageError(f"the split {split.name} has no scene of {where}; its scenes are {ranges(split.scenes)}")
    return packs


def seeds_in_split(split: Split, seeds: str | None, usual: int = USUAL_SEEDS) -> tuple[int, ...]:
    """The seeds of a split that `--seeds` selects; without it the first ones.

    Args:
        split: The split.
        seeds: Value of `--seeds`; None if it was not given.
        usual: Number of seeds if `seeds` is None.

    Raises:
        UsageError: A part is malformed or is not a seed of the split.
    """
    if seeds is None:
        return tuple(split.seeds[:usual])
    chosen = parse_numbers(seeds, "--seeds", 0)
    for seed in chosen:
        if seed not in split.seeds:
            raise UsageError(f"--seeds {seed}: the split {split.name} has the seeds {split.seeds[0]}-{split.seeds[-1]}")
    return chosen


def _select(part: str, packs: dict[int, PackFiles]) -> set[int]:
    if part == SUITE:
        found = {scene for scene, files in packs.items() if _rung(files) is not Rung.OPEN}
        if not found:
            raise UsageError(f"--scenes {part}: every scene here is an open world; select them with --scenes open")
        return found
    if part in set(Rung):
        return {scene for scene, files in packs.items() if _rung(files) == part}
    if part.startswith("category:"):
        name = part.removeprefix("category:")
        if name not in set(Category):
            raise UsageError(f"--scenes {part}: the categories are {', '.join(Category)}")
        return {scene for scene, files in packs.items() if read_pack(files).category == name}
    low, dash, high = part.partition("-")
    if not low.isdecimal() or (dash and not high.isdecimal()):
        raise UsageError(
            f"--scenes {part}: write ids and ranges such as 7,9,20-30, {SUITE}, {', '.join(Rung)},"
            f" or category:{next(iter(Category))}"
        )
    return {scene for scene in packs if int(low) <= scene <= int(high or low)}


def _rung(files: PackFiles) -> Rung | None:
    category = read_pack(files).category
    return category.rung if category else None


MOST_NUMBERS = 1_000_000
"""Largest number of values that a range of an option may have."""


def parse_numbers(text: str, option: str, least: int) -> tuple[int, ...]:
    """Parse whole numbers and ranges separated by commas, such as `0,3-5`. Keeps their order and drops duplicates.

    Raises:
        UsageError: A part is not a whole number or range, is below `least`, or has more than `MOST_NUMBERS` numbers.
    """
    numbers: list[int] = []
    for part in text.split(","):
        low, dash, high = part.strip().partition("-")
        if not low.isdecimal() or (dash and not high.isdecimal()):
            raise UsageError(f"{option} {part.strip() or text}: write whole numbers and ranges such as 5,10 or 0-9")
        found = range(int(low), int(high or low) + 1)
        if int(high or low) - int(low) >= MOST_NUMBERS:
            raise UsageError(
                f"{option} {part.strip()}: names more than {MOST_NUMBERS:,} numbers; write a shorter range"
            )
        numbers += found
    if not numbers or min(numbers) < least:
        raise UsageError(f"{option} {text}: must be {least} or more")
    return tuple(dict.fromkeys(numbers))
