"""`physment-eval replay-original`: replays the authors' published logs with this project's parser, tools and grader."""

import argparse
import json
import os
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.console import Console

from evaluator.answers.keys import KeyRing
from evaluator.commands.base import Commands, count_of, file_to_write, folder_to_write, run_async
from evaluator.commands.terminal import ProgressDisplay, Tally
from evaluator.episode.connect import connect
from evaluator.errors import UsageError
from evaluator.original.logs import LoggedEpisode, as_logged, find_logs
from evaluator.original.play import PlayedLog, play_logs
from evaluator.original.summary import Compared, compare, markdown, rows
from evaluator.records.run import Plan
from evaluator.store.run_folder import RunFolder
from evaluator.study.run_start import run_record, server_record
from evaluator.study.runner import Meter
from evaluator.study.selection import parse_scenes
from scenes import read_pack

_DESCRIPTION = """\
Play the logs that the authors of the paper published again: each reply of a model goes through our text parser, its
calls through our tools on the authors' packs, its answer through our grader. Reports which replies could be parsed,
what happened to the calls, and why verdicts differ from the logged ones and from Eq. 1 of the paper.

The authors' packs are not sound: agreement with their keys tests the grader, not physics.
Exit code: 0 all logs were played; 1 the laboratory failed on some.
"""


def add(commands: Commands) -> None:
    """Declare the command `replay-original` and its options."""
    command = commands.add_parser(
        "replay-original",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(run=_replay)
    command.add_argument(
        "logs", type=Path, metavar="LOGS", help="folder with MODEL/scene_NNN/summary_TIME.txt below it"
    )
    command.add_argument("--scenes-dir", type=Path, required=True, metavar="SCENES", help="the authors' packs")
    command.add_argument("--limit", type=count_of("logs"), metavar="N", help="play only the first N logs")
    command.add_argument(
        "--jobs",
        type=count_of("logs"),
        default=min(4, os.cpu_count() or 1),
        metavar="N",
        help="played at a time (%(default)s)",
    )
    command.add_argument("--server", default="host", metavar="S", help="as for run (default host)")
    command.add_argument("--json", action="store_true", help="print figures and every disagreement as JSON")
    command.add_argument(
        "--keep",
        type=folder_to_write,
        metavar="DIR",
        help="keep the episodes as a run folder, for grade, report and replay",
    )
    command.add_argument(
        "--as-logged",
        action="store_true",
        help="with --keep, keep the logged episodes with the results that the models read, not the replayed ones",
    )
    command.add_argument("--out", type=file_to_write, metavar="FILE", help="write the tables to FILE as Markdown")


def _replay(args: argparse.Namespace) -> int:
    if args.as_logged and not args.keep:
        raise UsageError("--as-logged says what --keep keeps; give a folder with --keep DIR")
    packs = parse_scenes(None, args.scenes_dir)
    names = {files.scene_id: read_pack(files).metadata.scene_name for files in packs}
    logs = find_logs(args.logs)[: args.limit]
    keys = KeyRing(args.scenes_dir)
    folder = RunFolder(args.keep) if args.keep else None
    if folder is not None:
        folder.create(resume=False)

    async def play() -> list[PlayedLog]:
        async with connect(args.server, args.scenes_dir) as laboratory:
            async with laboratory.open(packs[0].scene_id, 0) as client:
                server = await server_record(client, args.server)
            agent = "original-logs-as-logged" if args.as_logged else "original-logs"
            plan = Plan(scenes=tuple(names), agents=(agent,), budgets=(), protocols=("text",))
            record = run_record(plan, packs, server)
            if folder is not None:
                folder.write_run(record)
            models = sorted({log.model for log in logs})
            with ProgressDisplay(Console(stderr=True), len(logs), Tally(keys, Meter(), models)) as display:

                def ended(replayed: PlayedLog) -> None:
                    episode = replayed.episode
                    if episode is not None and folder is not None:
                        folder.append_episode(
                            as_logged(replayed.log, episode.key, episode.versions) if args.as_logged else episode
                        )
                    if episode is not None and sys.stderr.isatty():
                        display.ended(episode)

                return await play_logs(
                    logs, laboratory, keys, names, versions=record.versions_of, jobs=args.jobs, on_end=ended
                )

    played = run_async(play)
    if not played:
        raise UsageError(f"{args.logs}: none of its logs holds a reply in a scene of {args.scenes_dir}")
    return _report(args, logs, played)


def _report(args: argparse.Namespace, logs: Sequence[LoggedEpisode], played: Sequence[PlayedLog]) -> int:
    """Compare the replays with the logs, write and print the comparison; returns the exit code."""
    compared = [compare(log) for log in played]
    tables = markdown(rows(compared))
    if args.out is not None:
        try:
            args.out.write_text(tables, encoding="utf-8")
        except OSError as error:
            raise UsageError(f"--out {args.out} cannot be written: {error.strerror}") from error
    silent = sum(not log.replies for log in logs)
    left_out = {"no reply": silent, "no pack": len(logs) - len(played) - silent}
    if args.json:
        print(_as_json(compared, left_out))
    else:
        print(tables)
        print("logs left out: " + ", ".join(f"{count} with {why}" for why, count in left_out.items()))
    return 1 if any(log.failure for log in played) else 0


def _as_json(compared: Sequence[Compared], left_out: Mapping[str, int]) -> str:
    disagreements = [
        {
            "log": str(result.played.log.path),
            "model": result.played.log.model,
            "budget": result.played.log.budget,
            "scene": result.played.scene,
            "answer": result.answer,
            "key": result.played.key,
            "logged": result.played.log.verdict and result.played.log.verdict.right,
            "logged_answer": result.played.log.verdict and result.played.log.verdict.answer,
            "strict": result.strict,
            "normalised": result.normalised,
            "eq1": result.by_eq1,
            "why": result.disagreement,
            "why_not_eq1": result.eq1_disagreement,
        }
        for result in compared
        if result.disagreement or result.eq1_disagreement
    ]
    table = [row.model_dump(mode="json") for row in rows(compared)]
    return json.dumps({"left_out": left_out, "rows": table, "disagreements": disagreements}, ensure_ascii=False)
