"""`physment-eval grade` and `merge`: what is made of recorded episodes."""

import argparse
import sys
from pathlib import Path

from rich.console import Console

from evaluator.answers.keys import KeyRing
from evaluator.commands.base import Commands
from evaluator.commands.report import report_on
from evaluator.commands.terminal import print_results
from evaluator.records import Outcome
from evaluator.scores import scoring
from evaluator.store import RunFolder
from evaluator.study.merging import expand, merge

_GRADE = """\
Grade a stored run again, after a change of the grader or of a pack, and write its summary and report. Where a verdict
changes, the grades of before are kept beside the new ones and every change is listed.
"""
_MERGE = """\
Put the shards of a run, or parts of a study, together into one run folder, grade it and write its report. A folder that
holds shards stands for all of them.
"""


def add(commands: Commands) -> None:
    """Declare `grade` and `merge`."""
    grade = commands.add_parser("grade", help="grade a stored run again", description=_GRADE)
    grade.set_defaults(run=_grade)
    merging = commands.add_parser("merge", help="put shards or parts together", description=_MERGE)
    merging.set_defaults(run=_merge)
    merging.add_argument("folders", type=Path, nargs="+", metavar="DIR", help="run folders, or folders of shards")
    merging.add_argument("--out", type=Path, required=True, metavar="DIR", help="the new run folder")
    grade.add_argument("folder", type=Path, help="run folder")
    for command in (grade, merging):
        command.add_argument("--scenes-dir", type=Path, metavar="DIR", help="folder of scene packs of the run")
        command.add_argument("--json", action="store_true", help="print the summary as JSON on stdout")


def _grade(args: argparse.Namespace) -> int:
    folder = RunFolder(args.folder)
    folder.read_run()
    return finish(folder, KeyRing(args.scenes_dir), Console(stderr=args.json), as_json=args.json)


def _merge(args: argparse.Namespace) -> int:
    folder = RunFolder(args.out)
    merge(expand(args.folders), folder)
    return finish(folder, KeyRing(args.scenes_dir), Console(stderr=args.json), as_json=args.json)


def finish(folder: RunFolder, keys: KeyRing, console: Console, *, as_json: bool, wanted: int | None = None) -> int:
    """Grade, summarise, report, print; returns the exit code.

    Args:
        folder: The run.
        keys: Answer keys of its scenes.
        console: Where the tables go.
        as_json: Whether the summary goes to stdout as JSON.
        wanted: How many episodes there should be; None for those there are.
    """
    episodes = folder.episodes()
    changes, summary = scoring.grade_run(folder, episodes, keys)
    report_on(folder, keys)
    grades = folder.grades()
    print_results(console, episodes, grades, summary)
    for line in changes:
        console.print(line, highlight=False, markup=False, soft_wrap=True)
    console.print(f"run folder: {folder.path}   report: {folder.report_file}", highlight=False, soft_wrap=True)
    if as_json:
        print(summary.model_dump_json())
    unplayed = sum(one.outcome is Outcome.INFRASTRUCTURE_ERROR for one in episodes.values())
    left = 0 if wanted is None else wanted - len(episodes)
    if unplayed or left > 0:
        said = [f"{unplayed} episodes could not be played"] if unplayed else []
        said += [f"{left} episodes are not played yet"] if left > 0 else []
        print(f"physment-eval: {', '.join(said)}; try --resume", file=sys.stderr)
        return 1
    return 0
