"""The commands with which a run is published: `submit`, `check-submission`, `board` and `reveal-seeds`."""

import argparse
import json
import os
from pathlib import Path

from evaluator.agents.recorded import load_recorded
from evaluator.answers.keys import KeyRing
from evaluator.commands.base import Commands, count_of, file_to_write, run_async, seed_key
from evaluator.episode.connect import connect
from evaluator.errors import UsageError
from evaluator.report.board import BoardEntry, board_page, tracks_of
from evaluator.store.durable import replace
from evaluator.store.run_folder import RunFolder
from evaluator.study.integrity import read_revealed, reveal, seed_key_file, seeds_of
from evaluator.study.replay import Replayed, replay
from evaluator.study.submission import first_difference, read_submission, submission_of
from scenes import ErratumEffect, reference_of

_SUBMIT = """\
Write the results of a whole run into one JSON file for a leaderboard: summary, provenance, hashes of the records, the
head of their seal, and the commitment to held-back seeds if there are any. Incomplete, unsealed and edited runs are
refused. Publish the file; keep the run folder, or publish it too.
"""
_CHECK = """\
Check a submission against its run folder. The folder is graded again and the submission made again: every field must be
the same. Then every episode is replayed: the laboratory must return what the records say.

This proves that the file holds the results of these records, by the packs and the grader of this machine, and that the
laboratory at --server returns the recorded readings to the recorded calls. It cannot prove who made the calls, or how:
the seal is a checksum without a secret, so whoever forges a run can seal it again and passes the first part. Forged
readings are found by the replay alone, in a place that you trust: your machine, your packs, your server. Forged calls
and answers that fit the laboratory are not found.

Exit code: 0 both parts agree; 1 a replay differs; 2 the submission or the folder was changed, or they do not belong
together.
"""


def add(commands: Commands) -> None:
    """Declare the commands `submit`, `check-submission`, `board` and `reveal-seeds` and their options."""
    _add_submit(commands)
    _add_board(commands)
    _add_reveal_seeds(commands)


def _add_submit(commands: Commands) -> None:
    submit = commands.add_parser("submit", description=_SUBMIT)
    submit.set_defaults(run=_submit)
    check = commands.add_parser(
        "check-submission",
        description=_CHECK,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    check.set_defaults(run=_check)
    check.add_argument("file", type=Path, metavar="FILE", help="the submission")
    for command in (submit, check):
        command.add_argument("folder", type=Path, metavar="DIR", help="run folder")
        command.add_argument("--scenes-dir", type=Path, metavar="DIR", help="folder of scene packs of the run")
        seed_key(command)
    submit.add_argument(
        "--out", type=file_to_write, metavar="FILE", help="where to (default submission.json in the run folder)"
    )
    check.add_argument(
        "--server", default="host", metavar="S", help="stdio · host (default) · the URL of a host · a command"
    )
    check.add_argument(
        "--concurrency",
        type=count_of("episodes"),
        default=min(4, os.cpu_count() or 1),
        metavar="N",
        help="episodes replayed at a time (default %(default)s)",
    )


def _submit(args: argparse.Namespace) -> int:
    folder = RunFolder(args.folder)
    submission = submission_of(folder, KeyRing(args.scenes_dir, seeds_of(folder, args.seed_key)))
    target = args.out or folder.path / "submission.json"
    folder.write_text(target, submission.model_dump_json(indent=2) + "\n")
    print(f"{target}: {submission.seal.lines} episodes, seal {submission.seal.head}")
    return 0


def _check(args: argparse.Namespace) -> int:
    folder, claimed = RunFolder(args.folder), read_submission(args.file)
    seed_of = seeds_of(folder, args.seed_key)
    keys = KeyRing(args.scenes_dir, seed_of)
    # An erratum that was published after the submission does not make its results false.
    noted = ErratumEffect.NOTED
    errata = [one for one in keys.errata.values() if one.effect is noted or one.pack in claimed.withdrawn]
    played = set(claimed.run.content_hashes().values())
    later = [entry for entry in keys.errata.values() if entry not in errata and entry.pack in played]
    difference = first_difference(claimed, submission_of(folder, KeyRing(args.scenes_dir, seed_of, errata)))
    if difference:
        raise UsageError(f"{args.file} does not state the results of {args.folder}: {difference}")
    agent, contracts = load_recorded(args.folder), claimed.run.tool_contracts()

    async def play() -> list[Replayed]:
        async with connect(args.server, args.scenes_dir, seed_of=seed_of) as laboratory:
            return await replay(agent, laboratory, contracts=contracts, concurrency=args.concurrency)

    results = run_async(play)
    wrong = next((one for one in results if one.differences or one.failure), None)
    if wrong is not None:
        print(f"{args.file} cannot be confirmed: {_place(wrong)}")
        return 1
    calls = sum(one.calls for one in results)
    for entry in later:
        print(f"scene {reference_of(entry.scene)} was withdrawn after the submission: {entry.fault}")
    print(f"{args.file} is what {args.folder} gives: {len(results)} episodes graded again, {calls} calls replayed")
    return 0


def _place(replayed: Replayed) -> str:
    key = replayed.key
    where = f"scene {reference_of(key.scene)}, seed {key.seed}, {key.agent}, budget {key.budget}, epoch {key.epoch}"
    if replayed.failure:
        return f"{where} could not be replayed: {replayed.failure}"
    found = replayed.differences[0]
    return f"{where}, turn {found.turn}, call {found.call}, {found.what}: recorded {found.stored}, replayed {found.now}"


_BOARD = """\
Write a leaderboard of the submissions in a folder: one page, which loads nothing else.

  physment-eval submit runs/mine --out submissions/mine.json
  physment-eval board submissions            # submissions/board.html

Every *.json file of the folder is a submission. Model and scaffold have columns of their own, and only agents on the
same variants, packs, budgets and scoring rules are ranked together. The files are not checked: `check-submission` does.
"""


def _add_board(commands: Commands) -> None:
    board = commands.add_parser(
        "board",
        help="write a leaderboard page of submissions",
        description=_BOARD,
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


_REVEAL = """\
Disclose the seeds of a run that was played with --seed-key, or check what its publisher disclosed.

  physment-eval reveal-seeds runs/mine --seed-key held-back.key   write the key into the folder and print the seeds
  physment-eval reveal-seeds runs/mine                            check the disclosed key and print the seeds

The key must fit the commitment in run.json, which was published with the run. Afterwards everybody can grade and replay
the run; `physment-eval grade` then writes the keys and the reasons that its grades lack. One line for each variant:
scene, number, seed. Exit code: 0 the key fits; 2 it does not, or there is none.
"""


def _add_reveal_seeds(commands: Commands) -> None:
    command = commands.add_parser(
        "reveal-seeds",
        description=_REVEAL,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(run=_reveal_seeds)
    command.add_argument("folder", type=Path, metavar="DIR", help="run folder")
    command.add_argument("--seed-key", type=Path, metavar="FILE", help="the key that the run was played with")
    command.add_argument("--json", action="store_true", help="print the seeds as JSON")


def _reveal_seeds(args: argparse.Namespace) -> int:
    folder = RunFolder(args.folder)
    plan = folder.read_run().plan
    if not plan.held_back:
        raise UsageError(f"{args.folder} was not played on held-back seeds: its records hold its seeds")
    if args.seed_key is not None:
        known = read_revealed(folder)
        reveal(folder, args.seed_key)
        if known is None:
            print(f"the key is written to {seed_key_file(folder)}")
    seed_of = seeds_of(folder, None)
    variants = sorted({(key.scene, key.seed) for key in plan.matrix()})
    if args.json:
        rows = [{"scene": scene, "number": number, "seed": seed_of(scene, number)} for scene, number in variants]
        print(json.dumps({"commitment": plan.held_back, "seeds": rows}))
    else:
        print(f"the key fits the commitment of the run, {plan.held_back}")
        for scene, number in variants:
            print(reference_of(scene), number, seed_of(scene, number))
    return 0
