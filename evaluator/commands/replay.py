"""`physment-eval replay` plays recorded episodes again; `replay-original` plays the published logs of the paper."""

import argparse
import json
import os
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from evaluator.agents.recorded import load_recorded
from evaluator.answers.keys import KeyRing
from evaluator.commands.base import (
    Commands,
    count_of,
    file_to_write,
    folder_to_write,
    run_async,
    seed_key,
    wide_console,
)
from evaluator.commands.terminal import ProgressDisplay, Tally
from evaluator.episode.connect import connect
from evaluator.errors import UsageError
from evaluator.original.logs import LoggedEpisode, as_logged, find_logs
from evaluator.original.play import PlayedLog, play_logs
from evaluator.original.summary import Compared, compare, markdown, rows
from evaluator.records.run import Plan
from evaluator.store.run_folder import RunFolder
from evaluator.study.integrity import refuse_other_worlds, seeds_of
from evaluator.study.meter import Meter
from evaluator.study.replay import REL_TOL, Replayed, replay
from evaluator.study.run_start import run_record, server_record
from evaluator.study.selection import parse_scenes
from scenes import read_pack, reference_of

_REPLAY = """\
Play the episodes of a run folder again: the same calls in the same turns. Each return is compared with the record.
Numbers count as the same up to one part in 10⁹; with --exact, only if they are equal. If the tools have changed since
the record, fields that they did not return then are counted, and not compared.

Exit code: 0 all returns are the same; 1 some are not, or an episode could not be played.
"""
_SHOWN = 100
"""Largest number of rows of the table; --json prints all differences."""
_WIDTH = 48


def add(commands: Commands) -> None:
    """Declare the commands `replay` and `replay-original` and their options."""
    _add_replay(commands)
    _add_replay_original(commands)


def _add_replay(commands: Commands) -> None:
    command = commands.add_parser(
        "replay",
        description=_REPLAY,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(run=_replay)
    command.add_argument("folder", type=Path, metavar="DIR", help="run folder")
    command.add_argument(
        "--server", default="host", metavar="S", help="stdio · host (default) · the URL of a host · a command"
    )
    command.add_argument("--scenes-dir", type=Path, metavar="DIR", help="folder of scene packs (default: the suite)")
    seed_key(command)
    command.add_argument("--exact", action="store_true", help="numbers must be equal to the last bit")
    command.add_argument(
        "--concurrency",
        type=count_of("episodes"),
        default=min(4, os.cpu_count() or 1),
        metavar="N",
        help="episodes played at a time (default %(default)s)",
    )
    command.add_argument("--json", action="store_true", help="print all differences as JSON instead of a table")


def _replay(args: argparse.Namespace) -> int:
    agent, folder = load_recorded(args.folder), RunFolder(args.folder)
    record = folder.read_run() if folder.run_file.exists() else None
    contracts = record.tool_contracts() if record else frozenset[str]()
    if record and args.server in {"host", "stdio"}:  # the packs of other servers are unknown
        refuse_other_worlds(record, args.scenes_dir)
    seed_of = seeds_of(folder, args.seed_key)

    async def play() -> list[Replayed]:
        async with connect(args.server, args.scenes_dir, seed_of=seed_of) as laboratory:
            rel_tol = 0.0 if args.exact else REL_TOL
            return await replay(agent, laboratory, contracts=contracts, rel_tol=rel_tol, concurrency=args.concurrency)

    results = run_async(play)
    if args.json:
        print(_differences_as_json(results))
    else:
        _print_differences(results)
    return 1 if any(replayed.differences or replayed.failure for replayed in results) else 0


def _differences_as_json(results: Sequence[Replayed]) -> str:
    return json.dumps(
        {
            "episodes": len(results),
            "calls": sum(replayed.calls for replayed in results),
            "differences": [found.model_dump(mode="json") for replayed in results for found in replayed.differences],
            "added_since": _added(results),
            "not_played": [
                {"key": replayed.key.model_dump(mode="json"), "error": replayed.failure}
                for replayed in results
                if replayed.failure
            ],
        },
        ensure_ascii=False,
    )


def _added(results: Sequence[Replayed]) -> Mapping[str, int]:
    return sum((Counter(replayed.added) for replayed in results), Counter[str]())


def _print_differences(results: Sequence[Replayed]) -> None:
    console = wide_console()
    differences = [difference for replayed in results for difference in replayed.differences]
    if differences:
        table = Table("scene", "seed", "agent", "budget", "turn", "call", "what", "stored", "now")
        for found in differences[:_SHOWN]:
            key, place = found.key, (found.turn, found.call, found.what)
            cells = (reference_of(key.scene), key.seed, key.agent, key.budget, *place, found.stored, found.now)
            table.add_row(*(escape(_cell(cell)) for cell in cells))
        console.print(table)
    if len(differences) > _SHOWN:
        console.print(f"… and {len(differences) - _SHOWN} more; --json prints all of them")
    for replayed in results:
        if replayed.failure:
            key = replayed.key
            console.print(f"scene {reference_of(key.scene)}, seed {key.seed}: not played: {escape(replayed.failure)}")
    same = sum(not replayed.differences and not replayed.failure for replayed in results)
    calls = sum(replayed.calls for replayed in results)
    if added := _added(results):
        fields = ", ".join(f"{name} (× {count})" for name, count in added.items())
        console.print(f"added since the record, and not compared: {fields}", markup=False, highlight=False)
    console.print(
        f"{len(results)} episodes, {calls} calls compared: {same} episodes the same, {len(differences)} differences",
        highlight=False,
    )


def _cell(value: object) -> str:
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= _WIDTH else f"{text[: _WIDTH - 1]}…"


_REPLAY_ORIGINAL = """\
Play the logs that the authors of the paper published again: each reply of a model goes through our text parser, its
calls through our tools on the authors' packs, its answer through our grader. Reports which replies could be parsed,
what happened to the calls, and why verdicts differ from the logged ones and from Eq. 1 of the paper.

The authors' packs are not sound: agreement with their keys tests the grader, not physics.
Exit code: 0 all logs were played; 1 the laboratory failed on some.
"""


def _add_replay_original(commands: Commands) -> None:
    command = commands.add_parser(
        "replay-original",
        description=_REPLAY_ORIGINAL,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(run=_play_logs)
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


def _play_logs(args: argparse.Namespace) -> int:
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
        print(_logs_as_json(compared, left_out))
    else:
        print(tables)
        print("logs left out: " + ", ".join(f"{count} with {why}" for why, count in left_out.items()))
    return 1 if any(log.failure for log in played) else 0


def _logs_as_json(compared: Sequence[Compared], left_out: Mapping[str, int]) -> str:
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
