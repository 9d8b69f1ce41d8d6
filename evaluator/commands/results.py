"""`physment-eval grade` and `merge`: grades, summary and report of recorded episodes."""

import argparse
import sys
from pathlib import Path

from rich.console import Console

from evaluator.answers.keys import KeyRing
from evaluator.commands.argument_types import folder_to_write, seed_key, trust_edited
from evaluator.commands.base import Commands
from evaluator.commands.report import report_on
from evaluator.commands.terminal import print_results
from evaluator.records import Outcome
from evaluator.scores.scoring import grade_run
from evaluator.store import RunFolder
from evaluator.study.held_back import is_withheld, pass_on_key, seeds_of
from evaluator.study.merging import expand, merge
from evaluator.study.sealing import seal_note

_GRADE = """\
Grade a stored run again, after a change of the grader or of a pack, and write its summary and report. If a verdict
changes, every change is listed and the previous grades are kept beside the new ones.
"""
_MERGE = """\
Merge the shards of a run, or the parts of a study, into one run folder, grade it and write its report. Of a folder that
holds shards, all shards are merged.
"""


def add(commands: Commands) -> None:
    """Declare `grade` and `merge`."""
    grade = commands.add_parser("grade", description=_GRADE)
    grade.set_defaults(run=_grade)
    merging = commands.add_parser("merge", description=_MERGE)
    merging.set_defaults(run=_merge)
    merging.add_argument("folders", type=Path, nargs="+", metavar="DIR", help="run folders, or folders of shards")
    merging.add_argument("--out", type=folder_to_write, required=True, metavar="DIR", help="the new run folder")
    grade.add_argument("folder", type=Path, help="run folder")
    for command in (grade, merging):
        trust_edited(command)
        seed_key(command)
        command.add_argument("--scenes-dir", type=Path, metavar="DIR", help="folder of scene packs of the run")
        command.add_argument("--json", action="store_true", help="print the summary as JSON on stdout")


def _grade(args: argparse.Namespace) -> int:
    folder = RunFolder(args.folder)
    folder.read_run()
    note = seal_note(folder, trust=args.trust_edited)
    keys = KeyRing(args.scenes_dir, seeds_of(folder, args.seed_key))
    return finish(folder, keys, Console(stderr=args.json), as_json=args.json, note=note)


def _merge(args: argparse.Namespace) -> int:
    folder = RunFolder(args.out)
    parts = expand(args.folders)
    keys = KeyRing(args.scenes_dir, seeds_of(parts[0], args.seed_key))
    merge(parts, folder, trust=args.trust_edited)
    pass_on_key(parts[0], folder)
    return finish(folder, keys, Console(stderr=args.json), as_json=args.json)


def finish(
    folder: RunFolder, keys: KeyRing, console: Console, *, as_json: bool, wanted: int | None = None, note: str = ""
) -> int:
    """Grade and score a run once; write its grades, summary and report; print the results.

    Args:
        folder: The run.
        keys: Answer keys of its scenes.
        console: Where the tables are printed.
        as_json: Whether the summary is printed to stdout as JSON.
        wanted: How many episodes the run should have; None if those that it has are all.
        note: What the seal says; by default the seal is checked.

    Returns:
        The exit code: 1 if episodes are missing or could not be played.
    """
    graded = grade_run(folder, keys, withhold=is_withheld(folder))
    report_on(folder, graded.rows, keys, note or seal_note(folder))
    print_results(console, graded)
    for line in graded.changes:
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    console.print(f"run folder: {folder.path}   report: {folder.report_file}", highlight=False, soft_wrap=True)
    if as_json:
        print(graded.summary.model_dump_json())
    unplayed = sum(row.episode.outcome is Outcome.INFRASTRUCTURE_ERROR for row in graded.rows)
    missing = 0 if wanted is None else wanted - len(graded.rows)
    if unplayed or missing > 0:
        problems = [f"{unplayed} episodes could not be played"] if unplayed else []
        problems += [f"{missing} episodes are not played yet"] if missing > 0 else []
        print(f"physment-eval: {', '.join(problems)}; try --resume", file=sys.stderr)
        return 1
    return 0
