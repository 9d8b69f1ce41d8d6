"""Reads the values of `--scenes`, `--budgets` and `--seeds`."""

from pathlib import Path

from evaluator.errors import UsageError
from scenes import Category, PackError, PackFiles, Rung, list_packs, read_pack

SUITE = "all"
"""Selects every scene but the open worlds, which are a track of their own."""


def parse_scenes(text: str | None, scenes_dir: Path | None) -> list[PackFiles]:
    """The packs that `--scenes` selects: ids, ranges, rungs, categories and `all`, separated by commas.

    A range selects the scenes that exist in it. A single id must exist. None selects every pack, also open worlds.

    Raises:
        UsageError: A part is malformed or selects nothing.
    """
    try:
        packs = {files.scene_id: files for files in list_packs(scenes_dir)}
        if text is None:
            return list(packs.values())
        chosen: set[int] = set()
        for part in text.split(","):
            found = _select(part.strip(), packs)
            if not found:
                raise UsageError(
                    f"--scenes {part.strip()}: there is no such scene; the scenes are {', '.join(map(str, packs))}"
                )
            chosen |= found
    except PackError as error:
        raise UsageError(str(error)) from error
    return [packs[scene] for scene in sorted(chosen)]


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


def parse_numbers(text: str, option: str, least: int) -> tuple[int, ...]:
    """Whole numbers and ranges separated by commas, such as `0,3-5`, in the order written, each number once.

    Raises:
        UsageError: A part is not a whole number or range, or is below `least`.
    """
    numbers: list[int] = []
    for part in text.split(","):
        low, dash, high = part.strip().partition("-")
        if not low.isdecimal() or (dash and not high.isdecimal()):
            raise UsageError(f"{option} {part.strip() or text}: write whole numbers and ranges such as 5,10 or 0-9")
        numbers += range(int(low), int(high or low) + 1)
    if not numbers or min(numbers) < least:
        raise UsageError(f"{option} {text}: must be {least} or more")
    return tuple(dict.fromkeys(numbers))
