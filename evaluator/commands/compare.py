"""`physment-eval compare`: compares two runs on their common episodes."""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.markup import escape
from rich.table import Table

from evaluator.answers.keys import KeyRing
from evaluator.commands.base import Commands, wide_console
from evaluator.commands.terminal import evidence_table
from evaluator.errors import UsageError
from evaluator.scores.comparison import CONDITIONS, Comparison, Side, compare, points
from evaluator.scores.scored_episode import law_sentence
from evaluator.scores.scoring import read_graded, score_episode
from evaluator.statistics.paired import PairedDifference
from evaluator.store.run_folder import RunFolder
from evaluator.study.selection import parse_numbers

_DESCRIPTION = """\
Say which of two runs is better on the episodes they have in common, by how much, and with what certainty.

  physment-eval compare runs/one runs/other
  physment-eval compare runs/study runs/study --a agent=model:x --b agent=model:y
  physment-eval compare runs/study runs/study --a budget=5 --b budget=20

Episodes are paired by scene, seed, epoch, and each of agent, budget, prompting, protocol of which a run has several.
"""
_WIDE = 110
"""Smallest width of a terminal at which the table has all its columns [characters]."""
_NARROW = ("A right", "B right", "B − A", "95 % interval", "p")
"""Columns of the table in a narrower terminal, so that no number is cut."""


def add(commands: Commands) -> None:
    """Declare the command `compare` and its options."""
    command = commands.add_parser(
        "compare",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(run=_compare)
    command.add_argument("first", type=Path, metavar="DIR", help="run folder A")
    command.add_argument("second", type=Path, metavar="DIR", help="run folder B")
    for side in ("a", "b"):
        command.add_argument(
            f"--{side}",
            action="append",
            default=[],
            metavar="NAME=VALUE",
            help=f"take only such episodes of {side.upper()}: {', '.join(CONDITIONS)} (may be repeated)",
        )
    command.add_argument("--without", metavar="N,…", help="scenes to leave out, such as 7 or 7,20-30")
    command.add_argument("--scenes-dir", type=Path, metavar="DIR", help="folder of scene packs of the runs")
    command.add_argument("--json", action="store_true", help="print everything as JSON instead of a table")


def _compare(args: argparse.Namespace) -> int:
    keys = KeyRing(args.scenes_dir)
    commitments = {RunFolder(path).read_run().plan.held_back for path in (args.first, args.second)}
    if len(commitments) > 1:
        raise UsageError(f"{args.first} and {args.second} were not played on the same held-back seeds")
    without = parse_numbers(args.without, "--without", 0) if args.without else ()
    a = _side(args.first, _chosen(args.a, "--a"), without, keys)
    b = _side(args.second, _chosen(args.b, "--b"), without, keys)
    found = compare(a, b)
    if args.json:
        print(found.model_dump_json())
    else:
        _print(found, args.first, args.second)
        _print_engines(args.first, args.second)
    return 0


def _chosen(words: Sequence[str], option: str) -> dict[str, str]:
    """Parse conditions of the form `NAME=VALUE`.

    Raises:
        UsageError: A word has another form, or its name is not a condition.
    """
    pairs = [word.partition("=") for word in words]
    for name, equals, value in pairs:
        if name not in CONDITIONS or not equals or not value:
            raise UsageError(f"{option} {name}{equals}{value}: write NAME=VALUE, NAME one of {', '.join(CONDITIONS)}")
    return {name: value for name, _, value in pairs}


def _side(path: Path, chosen: Mapping[str, str], without: Sequence[int], keys: KeyRing) -> Side:
    """Load one side of the comparison: a run, restricted to the chosen episodes.

    Raises:
        UsageError: Some episodes have no grade, or a pack is missing.
        StoreError: The folder cannot be read.
    """
    folder = RunFolder(path)
    presentation = folder.read_run().plan.presentation  # refuses a folder that holds no run
    evidence = folder.evidence()
    rows = [
        score_episode(episode, record, keys, evidence.get(episode.key))
        for episode, record in read_graded(folder)
        if episode.key.scene not in without
        and all(str(getattr(episode.key, name)) == value for name, value in chosen.items())
    ]
    return Side(str(path), rows, presentation)


def _print(found: Comparison, first: Path, second: Path) -> None:
    console = wide_console()
    console.print(escape(found.sentence), highlight=False, soft_wrap=True)
    console.print(escape(f"\nA = {found.a} [{first}]\nB = {found.b} [{second}]"), highlight=False, soft_wrap=True)
    narrow = console.width < _WIDE
    all_titles = ("scenes", "A right", "B right", "only A", "only B", "B − A", "95 % interval", "p")
    titles = _NARROW if narrow else all_titles
    table = Table("", *titles, box=None)
    for column in table.columns:
        column.no_wrap = True
    for column in table.columns[1:]:
        column.justify = "right"

    def add(name: str, difference: PairedDifference, p_value: float) -> None:
        cells = dict(zip(all_titles, _cells(difference, p_value, narrow=narrow), strict=True))
        table.add_row(name, *(cells[title] for title in titles))

    add("strict", found.strict, found.strict.p_value)
    add("normalised", found.normalised, found.normalised.p_value)
    grouping = ""
    for group in found.groups:
        if group.grouping != grouping:
            grouping = group.grouping
            table.add_row(f"[bold]{escape(grouping)}[/]")
        add(f"  {escape(group.group)}", group.difference, group.p_adjusted)
    console.print(table)
    sides = {name: side for name, side in (("A", found.evidence_a), ("B", found.evidence_b)) if side is not None}
    if sides:
        console.print(evidence_table(sides))
    for name, laws in (("A", found.laws_a), ("B", found.laws_b)):
        if laws is not None:
            console.print(f"{name}: {law_sentence(laws)}", highlight=False, soft_wrap=True)
    left_out = [
        f"{count} {what}"
        for count, what in (
            (found.only_a, "episodes of A without a counterpart"),
            (found.only_b, "episodes of B without a counterpart"),
            (found.unscored, "pairs that an infrastructure error ended"),
        )
        if count
    ]
    notes = ["differences in points of strict accuracy; p of groups adjusted within their grouping (Holm)"]
    notes += ["a wider terminal also shows the numbers of scenes and episodes"] if narrow else []
    notes += [f"left out: {', '.join(left_out)}"] if left_out else []
    for note in notes:
        console.print(note, highlight=False, soft_wrap=True)


def _print_engines(*runs: Path) -> None:
    """Print a note if two runs were played with different versions of MuJoCo."""
    engines = [RunFolder(path).read_run().versions.get("mujoco") for path in runs]
    if None not in engines and len(set(engines)) > 1:
        print(f"A was played with MuJoCo {engines[0]} and B with {engines[1]}, which may make a difference of its own")


def _cells(found: PairedDifference, p_value: float, *, narrow: bool) -> tuple[str, ...]:
    interval = "–" if found.interval is None else f"{points(found.interval.low)} to {points(found.interval.high)}"
    return (
        str(found.n_scenes),
        *(
            f"{'' if narrow else f'{correct}/{found.n} '}{100 * correct / found.n:5.1f} %"
            for correct in (found.first_correct, found.second_correct)
        ),
        str(found.only_first),
        str(found.only_second),
        points(found.difference),
        interval,
        f"{p_value:.3f}" if p_value >= 0.0005 else "< 0.001",
    )
