"""`physment-eval calibrate`: estimates scene difficulties and agent abilities on one scale, with standard errors."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from evaluator.answers.keys import KeyRing
from evaluator.calibration.model import features_of, responses
from evaluator.calibration.pages import calibration_page, calibration_text
from evaluator.calibration.results import calibrate
from evaluator.commands.base import Commands, folder_to_write
from evaluator.commands.terminal import printable
from evaluator.errors import StoreError, UsageError
from evaluator.records.episode import GradeRecord
from evaluator.scores.grouping import NO_RUNG
from evaluator.scores.scored_episode import is_withdrawn
from evaluator.scores.scoring import read_graded
from evaluator.store.run_folder import RunFolder
from scenes import Pack, PackError, Rung, content_hash_of, find_pack, read_pack, reference_of, same_pack

_DESCRIPTION = """\
Put agents and scenes on one scale of logits by a Rasch model, from graded runs: ability of each agent and difficulty
of each scene with standard errors, how well they fit (infit, outfit), scenes that separate negatively, information by
rung, and which episodes to add. Prints Markdown; --out writes calibration.json, .md and .html, too.

  physment-eval calibrate runs/one runs/other
  physment-eval calibrate runs/* --out calibration
"""


def add(commands: Commands) -> None:
    """Declare the command `calibrate` and its options."""
    command = commands.add_parser(
        "calibrate", description=_DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    command.set_defaults(run=_calibrate)
    command.add_argument("folders", type=Path, nargs="+", metavar="DIR", help="run folders")
    command.add_argument("--out", type=folder_to_write, metavar="DIR", help="where to write the files")
    command.add_argument("--scenes-dir", type=Path, metavar="DIR", help="folder of scene packs (default: the suite)")


def _calibrate(args: argparse.Namespace) -> int:
    rungs: dict[int, str] = {}
    runs = {str(path): _suite(RunFolder(path), args.scenes_dir, rungs) for path in args.folders}
    data = responses(runs)
    features = features_of(data.scenes, args.scenes_dir)
    packs = {one.key.scene: content_hash_of(one.pack_version) for grades in runs.values() for one in grades}
    found = calibrate(data, features, [rungs[scene] for scene in data.scenes], packs)
    text = calibration_text(found)
    print(printable(text, keep="\n"))
    if args.out is not None:
        try:
            args.out.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise StoreError(f"{args.out} cannot be written: {error.strerror}") from error
        target = RunFolder(args.out)
        title = ", ".join(path.resolve().name for path in args.folders)
        target.write_text(args.out / "calibration.json", found.model_dump_json(indent=2) + "\n")
        target.write_text(args.out / "calibration.md", text)
        target.write_text(args.out / "calibration.html", calibration_page(title, found))
        print(args.out / "calibration.html")
    return 0


def _suite(folder: RunFolder, scenes_dir: Path | None, rungs: dict[int, str]) -> Sequence[GradeRecord]:
    """Return the grades of a run on scenes of the suite, without open worlds and withdrawn packs.

    Args:
        folder: The run folder.
        scenes_dir: Folder of scene packs; None for the suite.
        rungs: Scene → rung; updated with the scenes of the run.
    """
    folder.read_run()
    keys = KeyRing(scenes_dir)
    kept: list[GradeRecord] = []
    for episode, grade in read_graded(folder):
        if episode.unsealed is not None:
            raise UsageError(
                f"{folder.path}: {grade.key.agent} could read the packs, so its results compare with nothing"
            )
        if is_withdrawn(episode, keys.erratum(grade.pack_version)):
            continue
        if grade.key.scene not in rungs:
            pack = _pack(grade, scenes_dir, folder)
            rungs[grade.key.scene] = pack.category.rung.value if pack.category else NO_RUNG
        if rungs[grade.key.scene] != Rung.OPEN:
            kept.append(grade)
    return kept


def _pack(grade: GradeRecord, scenes_dir: Path | None, folder: RunFolder) -> Pack:
    try:
        files = find_pack(grade.key.scene, scenes_dir)
        if not same_pack(grade.pack_version, files):
            raise UsageError(
                f"{folder.path} was played on another pack of scene {reference_of(grade.key.scene)} than the one here,"
                " whose features explain nothing of it; name the folder of its packs with --scenes-dir"
            )
        return read_pack(files)
    except PackError as error:
        raise UsageError(str(error)) from error
