"""`physment-eval report`: one or several runs as a page, as tables, as figures."""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

from evaluator.answers.keys import KeyRing
from evaluator.commands.base import Commands
from evaluator.errors import StoreError, UsageError
from evaluator.report.contenders import Run, contenders
from evaluator.report.export import csv_text, latex, markdown
from evaluator.report.page import write_report
from evaluator.report.pictures import pictures
from evaluator.report.tables import tables
from evaluator.scores import scoring
from evaluator.store import RunFolder
from scenes import PackError, list_packs, pack_hash

_DESCRIPTION = """\
Write report.html of stored runs, several side by side: accuracies with intervals, budgets, categories, dimensions,
failure modes, cost, and a notebook of each episode. The page opens from disk and needs nothing else.

  physment-eval report runs/mine                            runs/mine/report.html
  physment-eval report runs/mine runs/baselines --out out   out/report.html, both side by side
  physment-eval report runs/mine --export latex             the tables too: runs/mine/tables.tex
  physment-eval report runs/mine --figures svg              the figures too: runs/mine/figures/*.svg

Several runs need --out. Runs of different packs may stand in one report: name each folder of packs with --scenes-dir,
and every run finds its own.
"""


def add(commands: Commands) -> None:
    """Declare `report`."""
    command = commands.add_parser(
        "report",
        help="write the report of stored runs",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(run=_report)
    command.add_argument("folders", type=Path, nargs="+", metavar="DIR", help="run folders")
    command.add_argument("--out", type=Path, metavar="DIR", help="where to write (default: the run folder, if one)")
    command.add_argument(
        "--scenes-dir",
        type=Path,
        action="append",
        default=[],
        metavar="DIR",
        help="folder of scene packs that a run was played on (may be repeated; default: the suite)",
    )
    command.add_argument("--export", choices=("md", "csv", "latex"), help="write the tables in this form, too")
    command.add_argument("--figures", choices=("svg", "pdf"), help="write the figures, too; needs the extra `report`")


def report_on(folder: RunFolder, keys: KeyRing) -> Path:
    """Write the report of one graded run into its folder, and return where it is.

    Raises:
        UsageError: An episode is not graded, or a pack is missing.
        StoreError: The folder cannot be read or written.
    """
    return write_report(folder, [_read(folder, folder.path.resolve().name, keys)])


def _report(args: argparse.Namespace) -> int:
    if len(args.folders) > 1 and args.out is None:
        raise UsageError("several runs make one report: say where it goes with --out DIR")
    rings = [KeyRing(one) for one in args.scenes_dir] or [KeyRing()]
    if args.scenes_dir:
        rings.append(KeyRing())
    hashes = [_hashes(ring) for ring in rings]
    folders = [RunFolder(one) for one in args.folders]
    runs = [
        _read(folder, name, _ring_of(folder.read_run().packs, rings, hashes))
        for folder, name in zip(folders, _names(args.folders), strict=True)
    ]
    target = RunFolder(args.out or args.folders[0])
    try:
        target.path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StoreError(f"{target.path} cannot be written: {error.strerror}") from error
    written = [write_report(target, runs)]
    if args.export:
        written += _export(target, runs, args.export)
    if args.figures:
        from evaluator.report.figures import write_figures  # noqa: PLC0415 - matplotlib is an extra

        written += write_figures(target.path / "figures", contenders(runs), args.figures)
    for one in written:
        print(one)
    return 0


def _names(folders: Sequence[Path]) -> list[str]:
    """The last part of each folder; the whole of it where that is not enough."""
    short = [one.resolve().name for one in folders]
    return short if len(set(short)) == len(short) else [str(one) for one in folders]


def _hashes(ring: KeyRing) -> Mapping[str, str]:
    try:
        return {str(files.scene_id): pack_hash(files) for files in list_packs(ring.folder)}
    except PackError as error:
        raise UsageError(str(error)) from error


def _ring_of(played: Mapping[str, str], rings: Sequence[KeyRing], hashes: Sequence[Mapping[str, str]]) -> KeyRing:
    """Keys of the packs that a run was played on: the folder that holds most of them as they were; else the first."""
    alike = [sum(found.get(scene) == one for scene, one in played.items()) for found in hashes]
    return rings[alike.index(max(alike))]


def _read(folder: RunFolder, name: str, keys: KeyRing) -> Run:
    record, episodes, grades = folder.read_run(), folder.episodes(), folder.grades()
    if set(grades) != set(episodes):
        raise UsageError(f"{folder.path}: not every episode is graded; run `physment-eval grade {folder.path}` first")
    rows = scoring.scored(episodes.values(), grades.values(), keys)
    return Run(name, record, rows, grades, pictures(record.packs, keys.folder))


def _export(target: RunFolder, runs: Sequence[Run], form: str) -> list[Path]:
    """Write the tables: one file, or one for each table as CSV."""
    found = tables(contenders(runs))
    if form == "csv":
        texts = {f"tables-{one.name}.csv": csv_text(one) for one in found}
    else:
        texts = {"tables.md": markdown(found)} if form == "md" else {"tables.tex": latex(found)}
    for name, text in texts.items():
        target.write_text(target.path / name, text)
    return [target.path / name for name in texts]
