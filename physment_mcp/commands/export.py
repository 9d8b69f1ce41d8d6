"""`physment-mcp export`: scenes without their answers, for a host on another machine."""

import argparse
from pathlib import Path

from physment_mcp.commands.base import Commands, common_options, numbers, writing
from physment_mcp.contract.command_line import restore_sigint
from physment_mcp.errors import UsageError
from physment_mcp.scene import scene_ids
from scenes import default_folder, export_packs
from scenes.finding import is_in_split
from scenes.splits import HELD_BACK, Split, splits


def add(commands: Commands) -> None:
    """Declare `export`."""
    export = commands.add_parser(
        "export",
        parents=[common_options(again=True)],
        help="write scenes without their answers, for a host on another machine",
        description="Write scenes without their answers, for a host on another machine: their public halves, and the"
        " models drawn for some seeds. Serve them there with --scenes-dir DIR.",
    )
    export.add_argument("target", type=Path, metavar="DIR", help="folder to make")
    export.add_argument(
        "--scenes", type=_scenes, default=(), metavar="LIST", help="such as 7,21-30 or world:5:0-9 (default: all)"
    )
    export.add_argument(
        "--seeds", type=numbers, default=range(21), metavar="LIST", help="variants to draw (default 0-20)"
    )
    export.add_argument("--split", metavar="NAME", help="only the scenes and worlds of this split (default: all)")
    export.set_defaults(run=run)


def _scenes(text: str) -> list[list[int] | str]:
    """Parse scene numbers; references to worlds are returned as written."""
    return [part.strip() if part.strip().startswith("world:") else numbers(part) for part in text.split(",")]


def _ids(part: list[int] | str, scenes_dir: Path | None) -> list[int]:
    if not isinstance(part, str):
        return part
    from scenes.worlds.expansion import world_ids  # noqa: PLC0415 - it loads numpy and scipy

    return world_ids(part, scenes_dir or default_folder())


def _of_split(ids: list[int], name: str, scenes_dir: Path | None) -> list[int]:
    if name not in {*splits(), HELD_BACK}:
        raise UsageError(f"there is no split {name}; the splits are {', '.join(splits())} and {HELD_BACK}")
    split = splits().get(name) or Split(name, (), range(0), 0)  # held back: worlds of a key
    found = [scene for scene in ids if is_in_split(scene, split, scenes_dir)]
    if not found:
        raise UsageError(f"--split {name} has none of these scenes")
    return found


def run(args: argparse.Namespace) -> int:
    """Write the packs.

    Raises:
        SceneError: A pack is missing or malformed, or the folder is in use.
        UsageError: The folder cannot be written.
    """
    restore_sigint()
    with writing(args.target):
        ids = [scene for part in args.scenes for scene in _ids(part, args.scenes_dir)]
        if args.split:
            ids = _of_split(ids or scene_ids(args.scenes_dir), args.split, args.scenes_dir)
        written = export_packs(args.target, args.seeds, ids, args.scenes_dir)
    print(f"{written} scenes, {len(args.seeds)} seeds each: physment-mcp serve --scenes-dir {args.target}")
    return 0
