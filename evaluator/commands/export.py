"""`physment-eval export`: converts a run to the formats of other programs."""

import argparse
import functools
import sys
from pathlib import Path

from evaluator.answers.keys import KeyRing
from evaluator.commands.base import Commands, allow_modified, count_of, file_to_write, folder_to_write, run_async
from evaluator.commands.overview import EXPORTS_GROUP, plugin
from evaluator.episode.connect import connect
from evaluator.errors import StoreError, UsageError
from evaluator.records.run import Plan, ServerRecord
from evaluator.referee.tasks import WrittenSplit, has_parquet, write_tasks
from evaluator.referee.variants import Variants
from evaluator.report.every_eval_ever import Source, every_eval_ever
from evaluator.report.parquet import write_parquet
from evaluator.scores.scoring import read_graded
from evaluator.store.durable import replace
from evaluator.store.run_folder import RunFolder
from evaluator.study.integrity import seal_note
from evaluator.study.run_start import run_record
from evaluator.study.selection import parse_scenes

_DESCRIPTION = """\
Write a graded run for other programs, or the tasks of the suite for trainers.

  physment-eval export runs/mine --to parquet   runs/mine/exchanges.parquet: a row for each exchange, for data frames
  physment-eval export runs/mine --to inspect   runs/mine/inspect/*.eval: logs of Inspect AI, one for each condition

  physment-eval export runs/mine --to every-eval-ever --organization "Example University"
                                                runs/mine/data/physment/…: results and episodes in the format of
                                                Every Eval Ever, without answer keys

  physment-eval export --to tasks --out my_tasks     my_tasks/*.jsonl: prompts, tools and references, with a data card

The first needs the extra `parquet`, the second the plugin physment-inspect; with `parquet`, tasks are written in both
formats. Nothing in the run folder is changed.
"""


def add(commands: Commands) -> None:
    """Declare the command `export` and its options."""
    export = commands.add_parser(
        "export",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    export.set_defaults(run=_export)
    export.add_argument("folder", type=Path, nargs="?", metavar="DIR", help="run folder; none for tasks")
    export.add_argument(
        "--to", required=True, choices=("parquet", "inspect", "every-eval-ever", "tasks"), help="which format"
    )
    export.add_argument("--out", metavar="PATH", help="file of parquet, folder of the other formats")
    export.add_argument("--organization", metavar="NAME", help="every-eval-ever: who reports the results")
    export.add_argument(
        "--relationship",
        choices=("first_party", "third_party", "collaborative", "other"),
        default="third_party",
        help="every-eval-ever: of this organization to the makers of the model (third_party)",
    )
    export.add_argument(
        "--per-scene", type=count_of("seeds"), default=1, metavar="N", help="tasks: seeds of each scene (1)"
    )
    export.add_argument("--scenes", metavar="LIST", help="tasks: only these scenes, such as 7-20,easy (default: all)")
    allow_modified(export)


def _export(args: argparse.Namespace) -> int:
    if args.to == "tasks":
        return _tasks(args)
    if args.folder is None:
        raise UsageError(f"export --to {args.to}: name a run folder")
    if args.to == "every-eval-ever" and not args.organization:
        raise UsageError("export --to every-eval-ever: state who reports the results: --organization NAME")
    out = args.out and (file_to_write if args.to == "parquet" else folder_to_write)(args.out)
    folder = RunFolder(args.folder)
    run = folder.read_run()
    seal_note(folder, trust=args.allow_modified)
    graded = read_graded(folder)
    if args.to == "inspect":
        write = plugin(EXPORTS_GROUP, args.to, "export --to inspect")
        print(*write(out or folder.path / "inspect", run, graded), sep="\n")
        return 0
    if args.to == "every-eval-ever":
        source = Source(args.organization, args.relationship)
        for place, text in every_eval_ever(run, graded, source).items():
            target = Path(out or folder.path) / place
            _make_folder(target.parent)
            replace(target, text)
            print(target)
        return 0
    file = out or folder.path / "exchanges.parquet"
    _make_folder(file.parent)
    print(f"{file}: {write_parquet(file, run, graded)} exchanges")
    return 0


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StoreError(f"{folder} cannot be written: {error.strerror}") from error


def _tasks(args: argparse.Namespace) -> int:
    """Write the tasks of the suite.

    Raises:
        UsageError: A run folder is given, or the output folder is missing.
        StoreError: The folder cannot be written.
    """
    if args.folder is not None or args.out is None:
        raise UsageError("export --to tasks: takes no run folder, and writes into the folder --out DIR")
    folder = Path(folder_to_write(args.out))
    scenes = [files.scene_id for files in parse_scenes(args.scenes, None)] if args.scenes else None
    _make_folder(folder)
    for split in run_async(functools.partial(_written, folder, args.per_scene, scenes)):
        print(f"{', '.join(map(str, split.files))}: {split.rows} tasks of {split.scenes} scenes")
        for left_out in split.left_out:
            print(f"  {left_out} is left out: its reference does not solve it")
    if not has_parquet():
        print("no Parquet files: pyarrow is not installed (pip install 'physment-mcp[parquet]')", file=sys.stderr)
    return 0


async def _written(folder: Path, per_scene: int, scenes: list[int] | None) -> list[WrittenSplit]:
    record = run_record(Plan(scenes=(), agents=("reference",)), [], ServerRecord(option="host", protocol=""))
    async with connect("host", None) as laboratory:
        return await write_tasks(folder, laboratory, Variants(KeyRing(), record), per_scene, scenes)
