"""`physment-eval grade` and `merge`: grades, summary and report of a stored run, or of its merged shards or parts."""

import argparse
from pathlib import Path

from evaluator.answers.keys import KeyRing
from evaluator.commands.base import Commands, folder_to_write, results_console, stored_run_options
from evaluator.commands.finishing import finish
from evaluator.store.run_folder import RunFolder
from evaluator.study.integrity import (
    other_packs,
    pass_on_key,
    refuse_other_packs,
    refuse_other_worlds,
    seal_note,
    seeds_of,
)
from evaluator.study.shards import expand, merge

_GRADE = """\
Grade a stored run again, after a change of the grader or of the errata, and write its summary and report. If a verdict
changes, every change is listed and the previous grades are kept beside the new ones. Scenes that were played on another
version of their pack keep their grades. Episodes on a pack that is known to be faulty are withdrawn.
"""


def add(commands: Commands) -> None:
    """Declare the commands `grade` and `merge` and their options."""
    _add_grade(commands)
    _add_merge(commands)


def _add_grade(commands: Commands) -> None:
    command = commands.add_parser("grade", description=_GRADE)
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
    return finish(folder, keys, results_console(as_json=args.json), as_json=args.json, note=note, kept=other)


_MERGE = """\
Merge the shards of a run, or the parts of a study, into one run folder, grade it and write its report. Of a folder that
holds shards, all shards are merged.
"""


def _add_merge(commands: Commands) -> None:
    command = commands.add_parser("merge", description=_MERGE)
    command.set_defaults(run=_merge)
    command.add_argument("folders", type=Path, nargs="+", metavar="DIR", help="run folders, or folders of shards")
    command.add_argument("--out", type=folder_to_write, required=True, metavar="DIR", help="the new run folder")
    stored_run_options(command)


def _merge(args: argparse.Namespace) -> int:
    folder = RunFolder(args.out)
    parts = expand(args.folders)
    keys = KeyRing(args.scenes_dir, seeds_of(parts[0], args.seed_key))
    refuse_other_worlds(parts[0].read_run(), args.scenes_dir)
    if not args.allow_other_packs:
        refuse_other_packs(parts[0].read_run(), args.scenes_dir)
    merge(parts, folder, trust=args.allow_modified)
    pass_on_key(parts[0], folder)
    return finish(folder, keys, results_console(as_json=args.json), as_json=args.json)
