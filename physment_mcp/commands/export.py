"""`physment-mcp export`: scenes without their answers, for a host on another machine."""

import argparse
from pathlib import Path

from physment_mcp.commands.base import Commands, common_options, numbers, restore_sigint, writing
from scenes import export_packs


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
    export.add_argument("--scenes", type=numbers, default=(), metavar="LIST", help="such as 7,21-30 (default: all)")
    export.add_argument(
        "--seeds", type=numbers, default=range(21), metavar="LIST", help="variants to draw (default 0-20)"
    )
    export.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the packs.

    Raises:
        SceneError: A pack is missing or malformed, or the folder is in use.
        UsageError: The folder cannot be written.
    """
    restore_sigint()
    with writing(args.target):
        written = export_packs(args.target, args.seeds, args.scenes, args.scenes_dir)
    print(f"{written} scenes, {len(args.seeds)} seeds each: physment-mcp serve --scenes-dir {args.target}")
    return 0
