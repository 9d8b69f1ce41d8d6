"""`physment-eval board`: writes a static leaderboard page of submissions."""

import argparse
from pathlib import Path

from evaluator.commands.base import Commands, file_to_write
from evaluator.errors import UsageError
from evaluator.report.board import BoardEntry, board_page, tracks_of
from evaluator.store.durable import replace
from evaluator.study.submission import read_submission

_DESCRIPTION = """\
Write a leaderboard of the submissions in a folder: one page, which loads nothing else.

  physment-eval submit runs/mine --out submissions/mine.json
  physment-eval board submissions            # submissions/board.html

Every *.json file of the folder is a submission. Model and scaffold have columns of their own, and only agents on the
same variants, packs, budgets and scoring rules are ranked together. The files are not checked: `check-submission` does.
"""


def add(commands: Commands) -> None:
    """Declare the command `board` and its options."""
    board = commands.add_parser(
        "board",
        help="write a leaderboard page of submissions",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    board.set_defaults(run=_board)
    board.add_argument("folder", type=Path, metavar="DIR", help="folder of submissions")
    board.add_argument("--title", default="PhysMent leaderboard", metavar="T", help="title of the page")
    board.add_argument("--out", type=file_to_write, metavar="FILE", help="the page (default board.html in the folder)")


def _board(args: argparse.Namespace) -> int:
    files = sorted(args.folder.glob("*.json"))
    if not files:
        raise UsageError(f"{args.folder} holds no submission; `physment-eval submit` writes one for a run")
    found = [(file.name, read_submission(file)) for file in files]
    entries = [BoardEntry(name, one.run, one.summary, one.seal.head, one.unsealed_episodes) for name, one in found]
    target = args.out or args.folder / "board.html"
    replace(target, board_page(args.title, tracks_of(entries)))
    print(target)
    return 0
