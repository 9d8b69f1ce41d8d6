"""`physment-eval merge`: merges shards of a run, or parts of a study, into one run."""

import argparse
from pathlib import Path

from rich.console import Console

from evaluator.answers.keys import KeyRing
from evaluator.commands.base import Commands, folder_to_write, stored_run_options
from evaluator.commands.finishing import finish
from evaluator.store.run_folder import RunFolder
from evaluator.study.integrity import pass_on_key, refuse_other_packs, refuse_other_worlds, seeds_of
from evaluator.study.shards import expand, merge

_DESCRIPTION = """\
Merge the shards of a run, or the parts of a study, into one run folder, grade it and write its report. Of a folder that
holds shards, all shards are merged.
"""


def add(commands: Commands) -> None:
    """Declare the command `merge` and its options."""
    command = commands.add_parser("merge", description=_DESCRIPTION)
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
    return finish(folder, keys, Console(stderr=args.json), as_json=args.json)
