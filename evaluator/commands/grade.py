"""`physment-eval grade`: grades, summary and report of a stored run."""

import argparse
from pathlib import Path

from rich.console import Console

from evaluator.answers.keys import KeyRing
from evaluator.commands.base import Commands, stored_run_options
from evaluator.commands.finishing import finish
from evaluator.store.run_folder import RunFolder
from evaluator.study.integrity import other_packs, refuse_other_worlds, seal_note, seeds_of

_DESCRIPTION = """\
Grade a stored run again, after a change of the grader or of the errata, and write its summary and report. If a verdict
changes, every change is listed and the previous grades are kept beside the new ones. Scenes that were played on another
version of their pack keep their grades. Episodes on a pack that is known to be faulty are withdrawn.
"""


def add(commands: Commands) -> None:
    """Declare the command `grade` and its options."""
    command = commands.add_parser("grade", description=_DESCRIPTION)
    command.set_defaults(run=_grade)
    command.add_argument("folder", type=Path, help="run folder")
    stored_run_options(command)


def _grade(args: argparse.Namespace) -> int:
    folder = RunFolder(args.folder)
    record = folder.read_run()
    refuse_other_worlds(record, args.scenes_dir)
    other = [] if args.allow_other_packs else other_packs(record, args.scenes_dir)
    note = seal_note(folder, trust=args.allow_modified)
    keys = KeyRing(args.scenes_dir, seeds_of(folder, args.seed_key))
    return finish(folder, keys, Console(stderr=args.json), as_json=args.json, note=note, kept=other)
