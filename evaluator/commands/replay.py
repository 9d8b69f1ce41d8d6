"""`physment-eval replay`: repeats the calls of recorded episodes and lists every difference in the results."""

import argparse
import json
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from evaluator.agents.recorded import load_recorded
from evaluator.commands.base import Commands, count_of, run_async, seed_key, wide_console
from evaluator.episode.connect import connect
from evaluator.store.run_folder import RunFolder
from evaluator.study.integrity import refuse_other_worlds, seeds_of
from evaluator.study.replay import REL_TOL, Replayed, replay
from scenes import reference_of

_DESCRIPTION = """\
Play the episodes of a run folder again: the same calls in the same turns. Each return is compared with the record.
Numbers count as the same up to one part in 10⁹; with --exact, only if they are equal. If the tools have changed since
the record, fields that they did not return then are counted, and not compared.

Exit code: 0 all returns are the same; 1 some are not, or an episode could not be played.
"""
_SHOWN = 100
"""Largest number of rows of the table; --json prints all differences."""
_WIDTH = 48


def add(commands: Commands) -> None:
    """Declare the command `replay` and its options."""
    command = commands.add_parser(
        "replay",
        description=_DESCRIPTION,
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
        print(_as_json(results))
    else:
        _print(results)
    return 1 if any(replayed.differences or replayed.failure for replayed in results) else 0


def _as_json(results: Sequence[Replayed]) -> str:
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


def _print(results: Sequence[Replayed]) -> None:
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
