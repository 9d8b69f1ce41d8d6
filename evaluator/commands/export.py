"""`physment-eval export`: converts a run to the formats of other programs."""

import argparse
from pathlib import Path

from evaluator.commands.base import Commands, allow_modified, file_to_write, folder_to_write
from evaluator.commands.overview import EXPORTS_GROUP, plugin
from evaluator.errors import StoreError
from evaluator.report.parquet import write_parquet
from evaluator.scores.scoring import read_graded
from evaluator.store.run_folder import RunFolder
from evaluator.study.integrity import seal_note

_DESCRIPTION = """\
Write a graded run for other programs.

  physment-eval export runs/mine --to parquet   runs/mine/exchanges.parquet: a row for each exchange, for data frames
  physment-eval export runs/mine --to inspect   runs/mine/inspect/*.eval: logs of Inspect AI, one for each condition

The first needs the extra `parquet`, the second the plugin physment-inspect. Nothing in the run folder is changed.
"""


def add(commands: Commands) -> None:
    """Declare `export`."""
    export = commands.add_parser(
        "export",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    export.set_defaults(run=_export)
    export.add_argument("folder", type=Path, metavar="DIR", help="run folder")
    export.add_argument("--to", required=True, choices=("parquet", "inspect"), help="which format")
    export.add_argument("--out", metavar="PATH", help="file of parquet, folder of inspect")
    allow_modified(export)


def _export(args: argparse.Namespace) -> int:
    out = args.out and (folder_to_write if args.to == "inspect" else file_to_write)(args.out)
    folder = RunFolder(args.folder)
    run = folder.read_run()
    seal_note(folder, trust=args.allow_modified)
    graded = read_graded(folder)
    if args.to == "inspect":
        write = plugin(EXPORTS_GROUP, args.to, "export --to inspect")
        print(*write(out or folder.path / "inspect", run, graded), sep="\n")
        return 0
    file = out or folder.path / "exchanges.parquet"
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StoreError(f"{file.parent} cannot be written: {error.strerror}") from error
    print(f"{file}: {write_parquet(file, run, graded)} exchanges")
    return 0
