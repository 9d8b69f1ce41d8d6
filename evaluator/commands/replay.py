"""`physment-eval replay`: play stored transcripts again and tell every difference."""

import argparse
import json
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from evaluator.agents.recorded import load_recorded
from evaluator.commands.argument_types import count_of
from evaluator.commands.base import Commands, run_async, wide_console
from evaluator.episode.connect import connect
from evaluator.store import RunFolder
from evaluator.study.replay import REL_TOL, Replayed, replay

_DESCRIPTION = """\
Play the transcripts of a run folder again: the same calls in the same turns. Each return is compared with the stored
one; numbers count as the same to one part in 10⁹, or only exactly with --exact. Where the tools have changed since the
record, fields that they did not return then are counted, and not compared.

Exit code: 0 all returns are the same; 1 some are not, or an episode could not be played.
"""
_SHOWN = 100
"""Rows of the table; --json has them all."""
_WIDTH = 48


def add(commands: Commands) -> None:
    """Declare `replay`."""
    command = commands.add_parser(
        "replay",
        help="play stored transcripts again and compare the returns",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(run=_replay)
    command.add_argument("folder", type=Path, metavar="DIR", help="run folder")
    command.add_argument(
        "--server", default="host", metavar="S", help="stdio · host (default) · the URL of a host · a command"
    )
    command.add_argument("--scenes-dir", type=Path, metavar="DIR", help="folder of scene packs (default: the suite)")
    command.add_argument("--exact", action="store_true", help="numbers must be the same to the last bit")
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
    contracts = folder.read_run().tool_contracts() if folder.run_file.exists() else frozenset[str]()

    async def play() -> list[Replayed]:
        async with connect(args.server, args.scenes_dir) as laboratory:
            rel_tol = 0.0 if args.exact else REL_TOL
            return await replay(agent, laboratory, contracts=contracts, rel_tol=rel_tol, concurrency=args.concurrency)

    results = run_async(play)
    if args.json:
        print(_as_json(results))
    else:
        _print(results)
    return 1 if any(one.differences or one.failure for one in results) else 0


def _as_json(results: Sequence[Replayed]) -> str:
    return json.dumps(
        {
            "episodes": len(results),
            "calls": sum(one.calls for one in results),
            "differences": [found.model_dump(mode="json") for one in results for found in one.differences],
            "added_since": _added(results),
            "not_played": [
                {"key": one.key.model_dump(mode="json"), "error": one.failure} for one in results if one.failure
            ],
        },
        ensure_ascii=False,
    )


def _added(results: Sequence[Replayed]) -> Mapping[str, int]:
    return sum((Counter(one.added) for one in results), Counter[str]())


def _print(results: Sequence[Replayed]) -> None:
    console = wide_console()
    found = [difference for one in results for difference in one.differences]
    if found:
        table = Table("scene", "seed", "agent", "budget", "turn", "call", "what", "stored", "now")
        for one in found[:_SHOWN]:
            key = one.key
            cells = (key.scene, key.seed, key.agent, key.budget, one.turn, one.call, one.what, one.stored, one.now)
            table.add_row(*(escape(_cell(cell)) for cell in cells))
        console.print(table)
    if len(found) > _SHOWN:
        console.print(f"… and {len(found) - _SHOWN} more; --json tells them all")
    for one in results:
        if one.failure:
            console.print(f"scene {one.key.scene}, seed {one.key.seed}: not played: {escape(one.failure)}")
    same = sum(not one.differences and not one.failure for one in results)
    calls = sum(one.calls for one in results)
    if added := _added(results):
        fields = ", ".join(f"{name} (× {count})" for name, count in added.items())
        console.print(f"added since the record, and not compared: {fields}", markup=False, highlight=False)
    console.print(
        f"{len(results)} episodes, {calls} calls compared: {same} episodes the same, {len(found)} differences",
        highlight=False,
    )


def _cell(value: object) -> str:
    text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    return text if len(text) <= _WIDTH else f"{text[: _WIDTH - 1]}…"
