"""`physment-eval [run]`, `grade` and `report`: play episodes, grade them, write the report."""

import argparse
import contextlib
import os
import sys
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rich.console import Console

from evaluator import scoring
from evaluator.answer_key import KeyRing
from evaluator.commands.base import Commands, own_version, unwrapped, whole
from evaluator.connect import connect
from evaluator.display import ProgressDisplay, print_results
from evaluator.errors import InfrastructureError, UsageError
from evaluator.provenance import run_facts, server_facts
from evaluator.records import Outcome, Versions
from evaluator.report.page import write_report
from evaluator.runner import Plan, Runner, missing, pack_hash
from evaluator.selection import AGENTS, parse_agent, parse_numbers, parse_scenes
from evaluator.store import RunFolder


def add(commands: Commands, description: str) -> None:
    """Declare `run`, `grade` and `report`.

    Args:
        commands: Where.
        description: Help of `run`, the default command: that of the whole program.
    """
    run = commands.add_parser(
        "run",
        help="play episodes (the default)",
        description=description,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    run.set_defaults(run=_run)
    run.add_argument(
        "--server",
        default="stdio",
        metavar="S",
        help="stdio: a server process for each episode (default) · host: one warm local host · the URL of a host ·"
        " a command that serves one episode on stdio, with {scene} and {seed} in it",
    )
    run.add_argument("--agent", default="reference", metavar="A", help=f"{' · '.join(AGENTS)} (default reference)")
    run.add_argument("--scenes", metavar="SEL", help="such as 7-111 · 7,9 · category:easy-single (default: all)")
    run.add_argument("--budgets", default="20", metavar="N,…", help="iteration budgets (default 20)")
    run.add_argument(
        "--seeds", default="0", metavar="N,…", help="variants of each scene, such as 0 or 1-20 (default 0)"
    )
    run.add_argument("--epochs", type=whole, default=1, metavar="N", help="repetitions of each episode (default 1)")
    run.add_argument(
        "--concurrency",
        type=whole,
        default=min(4, os.cpu_count() or 1),
        metavar="N",
        help="episodes played at a time (default %(default)s)",
    )
    run.add_argument("--scenes-dir", type=Path, metavar="DIR", help="folder of scene packs (default: the suite)")
    run.add_argument("--out", type=Path, metavar="DIR", help="run folder (default runs/TIME-AGENT)")
    run.add_argument("--resume", action="store_true", help="go on with the run in --out")
    run.add_argument("--json", action="store_true", help="print the summary as JSON on stdout, all else on stderr")
    for name, action, text in (
        ("grade", _grade, "grade a stored run again and write its summary and report"),
        ("report", _report, "write the report of a stored run again"),
    ):
        command = commands.add_parser(name, help=text, description=text.capitalize() + ".")
        command.set_defaults(run=action)
        command.add_argument("folder", type=Path, help="run folder")
        command.add_argument("--scenes-dir", type=Path, metavar="DIR", help="folder of scene packs of the run")
        command.add_argument("--json", action="store_true", help="print the summary as JSON on stdout")


def _run(args: argparse.Namespace) -> int:
    packs = parse_scenes(args.scenes, args.scenes_dir)
    agent = parse_agent(args.agent, args.scenes_dir)
    plan = Plan(
        scenes=tuple(files.scene_id for files in packs),
        agent=agent.name,
        budgets=parse_numbers(args.budgets, "--budgets", 1),
        seeds=parse_numbers(args.seeds, "--seeds", 0),
        epochs=args.epochs,
    )
    if args.resume and args.out is None:
        raise UsageError("--resume needs the folder of the run: --out DIR")
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S")
    folder = RunFolder(args.out or Path("runs") / f"{stamp}-{agent.name.split(':')[0]}")
    folder.create(resume=args.resume)
    keys = KeyRing(args.scenes_dir)
    console = Console(stderr=args.json)

    async def play() -> None:
        async with connect(args.server, args.scenes_dir) as laboratory:
            try:
                async with laboratory.open(plan.scenes[0], plan.seeds[0]) as client:
                    said = await server_facts(client)
            except InfrastructureError as error:
                raise UsageError(str(error)) from error
            facts = run_facts(plan, packs, args.server, said)
            folder.write_run(_continued(folder, facts))
            hashes = {files.scene_id: pack_hash(files) for files in packs}
            todo = missing(plan.keys(), folder.episodes())
            with ProgressDisplay(console, len(todo)) as display:
                runner = Runner(
                    laboratory,
                    agent,
                    folder,
                    lambda scene: Versions(physment=own_version(), protocol=said["protocol"], pack=hashes[scene]),
                    args.concurrency,
                    display.started,
                    display.ended,
                )
                await runner.run(todo)

    try:
        # A malformed pack or a missing key should show before hours of play, not after.
        for scene in plan.scenes:
            for seed in plan.seeds:
                keys.key(scene, seed)
        unwrapped(play)
    except UsageError:
        # Only an empty folder can be removed so: nothing is left of a run that never began.
        with contextlib.suppress(OSError):
            folder.path.rmdir()
        raise
    except KeyboardInterrupt:
        print(f"physment-eval: interrupted; go on with: --out {folder.path} --resume", file=sys.stderr)
        return 130
    return _finish(folder, keys, console, as_json=args.json, wanted=len(plan.keys()))


def _grade(args: argparse.Namespace) -> int:
    folder = RunFolder(args.folder)
    folder.read_run()
    return _finish(folder, KeyRing(args.scenes_dir), Console(stderr=args.json), as_json=args.json)


def _report(args: argparse.Namespace) -> int:
    folder = RunFolder(args.folder)
    facts, episodes, grades = folder.read_run(), folder.episodes(), folder.grades()
    if set(grades) != set(episodes):
        raise UsageError(f"{folder.path}: not every episode is graded; run `physment-eval grade {folder.path}` first")
    rows = scoring.scored(episodes.values(), grades.values(), KeyRing(args.scenes_dir))
    write_report(folder, facts, rows, grades)
    print(folder.report_file)
    return 0


def _finish(folder: RunFolder, keys: KeyRing, console: Console, *, as_json: bool, wanted: int | None = None) -> int:
    """Grade, summarise, report, print; returns the exit code."""
    episodes = folder.episodes()
    summary = scoring.grade_run(folder, episodes, keys)
    grades = folder.grades()
    write_report(folder, folder.read_run(), scoring.scored(episodes.values(), grades.values(), keys), grades)
    print_results(console, episodes, grades, summary)
    console.print(f"run folder: {folder.path}   report: {folder.report_file}", highlight=False, soft_wrap=True)
    if as_json:
        print(summary.model_dump_json())
    unplayed = sum(one.outcome is Outcome.INFRASTRUCTURE_ERROR for one in episodes.values())
    if unplayed or (wanted is not None and len(episodes) < wanted):
        print(f"physment-eval: {unplayed} episodes could not be played; try --resume", file=sys.stderr)
        return 1
    return 0


def _continued(folder: RunFolder, facts: dict[str, Any]) -> dict[str, Any]:
    """`run.json` of a run that starts, or of one that goes on: as it was, with a note of each resumption.

    Raises:
        UsageError: The stored run has another plan or other packs, so the results would not belong together.
    """
    if not folder.run_file.exists():
        return facts
    before = folder.read_run()
    for name in ("plan", "packs"):
        if before.get(name) != facts[name]:
            raise UsageError(
                f"{folder.path} holds a run with other {name}; --resume needs the same, or choose another --out"
            )
    again = {name: facts[name] for name in ("created_at", "server", "versions", "git_revision")}
    return {**before, "resumed": [*before.get("resumed", []), again]}
