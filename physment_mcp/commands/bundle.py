"""`physment-mcp bundle`: the laboratory as one file for Claude Desktop."""

import argparse
from pathlib import Path

from physment_mcp.commands.base import Commands, common_options, writing
from physment_mcp.contract.command_line import restore_sigint
from physment_mcp.errors import UsageError

_SEEDS = range(21)


def add(commands: Commands) -> None:
    """Declare `bundle`."""
    bundle = commands.add_parser(
        "bundle",
        parents=[common_options(again=True)],
        help="write a bundle that Claude Desktop installs with one click",
        description="Write a bundle that Claude Desktop installs with one click: our code and the scenes, without their"
        " answers.",
    )
    bundle.add_argument("target", type=Path, metavar="FILE.mcpb", help="file to write")
    bundle.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the bundle.

    Raises:
        SceneError: A pack is missing or malformed.
        UsageError: The name of the file does not end in .mcpb, or it cannot be written.
    """
    from physment_mcp.bundle import write_bundle  # noqa: PLC0415 - --help need not wait for the engine

    if args.target.suffix != ".mcpb":
        raise UsageError(f"{args.target}: Claude Desktop opens files that end in .mcpb")
    restore_sigint()
    with writing(args.target):
        write_bundle(args.target, _SEEDS, args.scenes_dir)
    print(f"{args.target}: open it with Claude Desktop, or drag it into Settings > Extensions")
    return 0
