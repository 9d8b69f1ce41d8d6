"""`physment-eval worlds make|show|verify|publish`: laboratories generated from a grammar of laws."""

import argparse
import functools
import os
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from rich.console import Console

from evaluator.commands.base import Commands, count_of, folder_to_write, progress_bar, run_async, wide_console
from evaluator.errors import UsageError
from evaluator.store.durable import append_line, locked
from scenes import WorldError, default_folder, one_world, place_of
from scenes.world_names import LEVEL_IDS
from scenes.worlds.drawing import SPLITS
from scenes.worlds.folders import PUBLISHED, find_certificate, find_record
from scenes.worlds.levels import LEVELS, Difficulty, difficulty_of
from scenes.worlds.orders import PUBLIC, WorldOrder
from scenes.worlds.publishing import MOST_BYTES, publish
from scenes.worlds.records import (
    Certificate,
    WorldRecord,
    as_line,
    keys_file,
    lines_file,
    read_certificates,
    read_records,
)
from scenes.worlds.tasks import task_of

_MAKE = """\
Draw worlds of a level until enough are accepted, and append them to DIR as they are found:

  level-5.jsonl       a line for each world: terms, constants, questions
  level-5.keys.jsonl  a line for each certificate: key, bounds, what the engine said

A world is accepted if every part of its law matters, if its answers follow from what its limits allow to read, if
nobody finds them without, and if the engine gives the key of the theory. The command goes on where an interrupted one
was. Whoever has this program can make the same worlds, and so their keys: with --key-file only whoever has the key
can, and the structures are those of no public world.
"""
_SHOW = "Print what an agent is told of a world; with --private also its law, its key and its certificate."
_VERIFY = """\
Prove stored worlds again: theory, the engine and half the time step give the key, and the engine's course is that of
theory. Exit code: 0 all are sound, 1 some are not.
"""
_PUBLISH = """\
Write the first worlds of each level in --worlds-dir as a set to publish: level-5.jsonl and keys/level-5.keys.jsonl,
both with the suite's canary in their first line. A laboratory is installed without the folder keys. Refused are worlds
of a key, worlds of other settings than those of their level, gaps, and more than 2 MB.

  physment-eval worlds make --level 1-10 --count 100 --out made
  physment-eval worlds verify --worlds-dir made
  physment-eval worlds publish --worlds-dir made --out scenes/worlds/public
"""


def add(commands: Commands) -> None:
    """Declare the commands `worlds make`, `worlds show`, `worlds verify` and `worlds publish`."""
    family = commands.add_parser("worlds", description="Laboratories that are drawn from a grammar of laws.")
    actions = family.add_subparsers(dest="action", metavar="make|show|verify|publish", required=True)
    raw = argparse.RawDescriptionHelpFormatter
    make = actions.add_parser("make", help="make worlds of a level", description=_MAKE, formatter_class=raw)
    make.set_defaults(run=_make)
    make.add_argument("--level", type=_levels, required=True, metavar="L", help=f"1 to {LEVELS[-1]}, or a range: 1-10")
    make.add_argument(
        "--count", type=count_of("worlds"), default=10, metavar="N", help="worlds of each level (default 10)"
    )
    make.add_argument("--first", type=_index, default=0, metavar="N", help="number of the first one (default 0)")
    make.add_argument(
        "--split",
        choices=[name for name, _ in SPLITS],
        help="worlds with structures of this split alone (default: of ten in a row, 6 train, 2 validation, 2 test)",
    )
    make.add_argument("--out", type=folder_to_write, required=True, metavar="DIR", help="folder of worlds")
    make.add_argument("--key-file", type=Path, metavar="FILE", help="a key of held-back seeds (64 hexadecimal digits)")
    make.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="another value of an attribute of the level, such as terms=4 or kinds=strong,late (may be repeated)",
    )
    publish = actions.add_parser("publish", help="write a set to publish", description=_PUBLISH, formatter_class=raw)
    publish.set_defaults(run=_publish)
    publish.add_argument("--out", type=folder_to_write, required=True, metavar="DIR", help="folder to make")
    publish.add_argument(
        "--count", type=count_of("worlds"), default=100, metavar="N", help="the first N worlds of a level (default 100)"
    )
    show = actions.add_parser("show", help="what an agent is told of a world", description=_SHOW)
    show.set_defaults(run=_show)
    show.add_argument("world", metavar="LEVEL:INDEX", help="such as 5:17 or world:5:17")
    show.add_argument("--private", action="store_true", help="also what no agent may know")
    verify = actions.add_parser("verify", help="prove stored worlds again", description=_VERIFY, formatter_class=raw)
    verify.set_defaults(run=_verify)
    verify.add_argument("--level", type=_levels, metavar="L", help="a level, or a range: 1-10 (default: all in DIR)")
    for command in (show, verify):
        command.add_argument(
            "--worlds-dir",
            type=Path,
            default=default_folder() / PUBLISHED,
            metavar="DIR",
            help="folder of worlds (default: the published ones)",
        )
    publish.add_argument("--worlds-dir", type=Path, required=True, metavar="DIR", help="folder of worlds")
    for command in (make, verify):
        command.add_argument(
            "--workers",
            type=count_of("processes"),
            default=os.cpu_count() or 1,
            metavar="N",
            help="processes (default: one per core)",
        )


def _levels(text: str) -> range:
    low, dash, high = text.partition("-")
    levels = range(_level(low), _level(high if dash else low) + 1)
    if not levels:
        raise argparse.ArgumentTypeError(f"{text}: a range goes from the smaller level to the larger one")
    return levels


def _index(text: str) -> int:
    if not text.isdecimal() or int(text) >= LEVEL_IDS:
        raise argparse.ArgumentTypeError(f"{text} is not the number of a world, which is from 0 to {LEVEL_IDS - 1}")
    return int(text)


def _level(text: str) -> int:
    if not text.isdecimal() or len(text) > 2 or int(text) not in LEVELS:
        raise argparse.ArgumentTypeError(f"{text} is not a level from 1 to {LEVELS[-1]}")
    return int(text)


def _make(args: argparse.Namespace) -> int:
    secret = PUBLIC if args.key_file is None else _secret(args.key_file)
    orders = [WorldOrder(level, _difficulty(level, args.set), secret) for level in args.level]
    unmade: list[str] = []
    try:
        args.out.mkdir(mode=0o700, parents=True, exist_ok=True)  # keeps answer keys from other users
        with locked(args.out):
            for order in orders:
                unmade += _make_level(args, order)
    except WorldError as error:
        raise UsageError(str(error)) from error
    except OSError as error:
        raise UsageError(f"{args.out} cannot be written: {error.strerror}") from error
    for sentence in unmade:
        print(f"physment-eval: {sentence}", file=sys.stderr)
    return 1 if unmade else 0


def _make_level(args: argparse.Namespace, order: WorldOrder) -> list[str]:
    """Make the missing worlds of a level; returns an error message for each that could not be made."""
    from evaluator.certify.worlds import Made, Unmade, make_worlds  # noqa: PLC0415 - only this needs the engine

    refusals, unmade, console, started = Counter[str](), list[str](), wide_console(), time.monotonic()
    lines, keys = lines_file(args.out, order.level), keys_file(args.out, order.level)
    wanted = order.missing(order.indexes(args.count, args.split, args.first), args.out)

    def work(advance: Callable[[], None]) -> None:
        def on_made(found: Made | Unmade) -> None:
            if isinstance(found, Unmade):
                unmade.append(f"world:{order.level}:{found.index}: {found.reason}")
            else:
                # The record is written last: a world without one counts as incomplete and is made again.
                append_line(keys, as_line(found.certificate).encode())
                append_line(lines, as_line(found.record).encode())
                refusals.update(found.refusals)
            advance()

        making = functools.partial(
            make_worlds, order.level, order.difficulty, order.secret, wanted, args.workers, on_made
        )
        try:
            run_async(making)
        except* WorldError as errors:
            raise errors.exceptions[0] from errors

    _with_bar(console, f"worlds of level {order.level}", len(wanted), work)
    made, spent = len(wanted) - len(unmade), time.monotonic() - started
    rate = f" in {spent:.0f} s, {60 * made / spent:.3g} a minute" if made else ""
    draws = f" of {sum(refusals.values()) + made} draws" if made else ""
    console.print(
        f"{made} world{'s' * (made != 1)} of level {order.level} made{draws}{rate};"
        f" {args.count - len(wanted)} existed: {lines}"
    )
    if refusals:
        console.print("rejected draws, by reason:", markup=False)
    for reason, count in refusals.most_common():
        console.print(f"  {count:5d}  {reason}", markup=False)
    return unmade


def _difficulty(level: int, settings: list[str]) -> Difficulty:
    try:
        return difficulty_of(level).changed_by(settings)
    except WorldError as error:
        raise UsageError(f"--set: {error}") from error


def _secret(file: Path) -> str:
    from evaluator.study.integrity import read_seed_key  # noqa: PLC0415 - the study is loaded only here

    return read_seed_key(file, "--key-file").secret.hex()


def _with_bar(console: Console, what: str, total: int, work: Callable[[Callable[[], None]], None]) -> None:
    """Run work that advances a progress bar. The bar is shown only on a terminal."""
    with progress_bar(console, last="rate") as bar:
        task = bar.add_task(what, total=total, rate="")

        def advance() -> None:
            bar.advance(task)
            done, spent = bar.tasks[0].completed, bar.tasks[0].elapsed or 0.0
            bar.update(task, rate=f"{60 * done / spent:.3g} a minute" if spent else "")

        if total:
            work(advance)


def _show(args: argparse.Namespace) -> int:
    try:
        place = place_of(one_world(f"world:{args.world.removeprefix('world:')}"))
        record = find_record(*place, args.worlds_dir)
        certificate = find_certificate(record, args.worlds_dir) if args.private else None
    except WorldError as error:
        raise UsageError(f"{args.worlds_dir}: {error}") from error
    console = wide_console()
    console.print(task_of(record), markup=False, highlight=False, soft_wrap=True)
    if record.told.errors:
        bounds = f"a bias of at most {record.bias:g} and a drift of at most {record.drift:g} per second"
        console.print(f"\nThe instrument for positions has {bounds}.", markup=False, highlight=False, soft_wrap=True)
    if args.private:
        console.print(f"\n{record.structure.label}\n{record.constants}", markup=False, soft_wrap=True)
        console.print(str(certificate or "no certificate"), markup=False, soft_wrap=True)
    return 0


def _publish(args: argparse.Namespace) -> int:
    try:
        sizes = publish(args.worlds_dir, args.out, args.count)
    except WorldError as error:
        raise UsageError(str(error)) from error
    total = f"{sum(sizes.values()):,} bytes of at most {MOST_BYTES:,}"
    print(f"{args.count} worlds of each of {len(sizes) // 2} levels, {total}: {args.out}")
    return 0


def _verify(args: argparse.Namespace) -> int:
    levels = args.level or [level for level in LEVELS if lines_file(args.worlds_dir, level).exists()]
    if not levels:
        raise UsageError(f"{args.worlds_dir} holds no worlds (level-1.jsonl, …)")
    console, wrong, checked = wide_console(), 0, 0
    for level in levels:
        worlds, missing = _certified(args.worlds_dir, level)
        faults = dict.fromkeys(missing, "no certificate") | _faults(console, level, worlds, args.workers)
        for index, fault in sorted(faults.items()):
            console.print(f"world:{level}:{index}: {fault}", markup=False, highlight=False)
        there = len(worlds) + len(missing)
        if len(levels) > 1:
            console.print(f"level {level}: {there - len(faults)} of {there}", highlight=False)
        wrong, checked = wrong + len(faults), checked + there
    console.print(f"{checked - wrong} of {checked} worlds are sound", highlight=False)
    return 1 if wrong else 0


def _faults(
    console: Console, level: int, worlds: list[tuple[WorldRecord, Certificate]], workers: int
) -> dict[int, str]:
    """Check worlds; return the fault of each faulty one, by its index."""
    from evaluator.certify.worlds import faults_of  # noqa: PLC0415 - only this command needs the engine

    faults: dict[int, str] = {}

    def work(advance: Callable[[], None]) -> None:
        def on_checked(record: WorldRecord, fault: str | None) -> None:
            advance()
            if fault is not None:
                faults[record.index] = fault

        run_async(lambda: faults_of(worlds, workers, on_checked))

    _with_bar(console, f"level {level}", len(worlds), work)
    return faults


def _certified(folder: Path, level: int) -> tuple[list[tuple[WorldRecord, Certificate]], list[int]]:
    """The certified worlds of a level with their certificates, and the indexes of worlds without one."""
    try:
        keys = {one.index: one for one in read_certificates(folder, level)}
        records = list(read_records(folder, level))
    except WorldError as error:
        raise UsageError(str(error)) from error
    found = [(record, keys[record.index]) for record in records if record.index in keys]
    return found, [record.index for record in records if record.index not in keys]
