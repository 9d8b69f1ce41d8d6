"""`physment-eval verify` and `lint`: check scenes by simulation, and check scene files statically."""

import argparse
import os
import sys
from importlib.metadata import version
from pathlib import Path

from rich.console import Console
from rich.table import Table
from rich.text import Text

from evaluator.certify.records import (
    CATCH_CERTIFICATES,
    CERTIFICATES,
    FAMILY_CERTIFICATES,
    PREDICTION_CERTIFICATES,
    Check,
    SceneCertificate,
    file_for,
    still_proven,
    write_certificates,
)
from evaluator.commands.base import Commands, count_of, progress_bar, run_async, wide_console
from evaluator.episode.hosts import LocalHost
from evaluator.study.selection import parse_scenes
from scenes import PackError, PackFiles, default_folder, read_errata, reference_of
from scenes.layout import lay_out, not_laid_out

_VERIFY = """\
Prove scenes sound by running them: certificates on many seeds.

  key         theory, engine, half the time step and the reference's answers agree, to a share of the tolerance
  twins       seeds have one opening prompt and the same readings at the start, but different keys
  modality    what must be created, found, deleted or attached cannot be done without
  constant    no constant answer is right more often than luck may be
  difficulty  the reference protocol is as long as the category says; a Hard scene without limits forces to adapt
  sane        nothing that `lint` finds; no deep contact at the start; no energy from nowhere

and, where a scene with limits asks for a prediction:

  unstageable direct attempts, a fixed batch of calls and the attackers do not find the answer
  tempting    natural shortcuts are wrong
  structure   seeds draw several laws; the wrong one, fitted to the reference's readings, gives a wrong answer
  instrument  the reference keeps the limits and needs at least half of them

and, where a scene names latches, nets, rims, guards or stops (`catches`):

  holds       they hold against the largest allowed loads, and readings stay consistent

and, where the pack names the family of laws that the task states:

  determined  every law of the family that fits the reference's readings gives the right answer; the state is stable

This runs the solution.py of each scene: name only folders you trust. The results go into certificates.json in the
folder of the scenes as they are found, so an interrupted run goes on where it was. A sound scene that has not changed
since keeps its certificate; --all proves it again. Certificates hold on the version of MuJoCo that is installed; those
of a second version go into a file of its own, such as certificates-4.0.0.json. Exit code: 0 all sound, 1 some are not.
"""
_TABLE_WIDTH = 194
"""Width of the table of all certificates [characters]."""
_LINT = """\
Say what is wrong with scenes without running them: fields, names, permissions, knobs, friction, time step.

It also names the JSON and XML files that are not laid out (width 110, short lists on one line). That is no fault;
--fix lays them out. The layout changes no content, so certificates and stored runs stay valid.

Exit code: 0 no fault; 1 a scene has a fault, or --fix cannot lay out a file.
"""


def add(commands: Commands) -> None:
    """Declare the commands `verify` and `lint`."""
    verify = commands.add_parser(
        "verify",
        description=_VERIFY,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    verify.set_defaults(run=_verify)
    lint = commands.add_parser(
        "lint",
        description=_LINT,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    lint.set_defaults(run=_lint)
    lint.add_argument("--fix", action="store_true", help="lay out the JSON and XML files first")
    for command in (verify, lint):
        command.add_argument(
            "--scene",
            "--scenes",
            dest="scenes",
            metavar="SEL",
            help="such as 7-111 · 7,9 · open · category:easy-single",
        )
        command.add_argument(
            "--scenes-dir", type=Path, metavar="DIR", help="folder of scene packs (default: the suite)"
        )
    verify.add_argument("--all", action="store_true", help="also prove again what is sound and unchanged")
    verify.add_argument("--seeds", type=count_of("seeds"), default=20, metavar="N", help="seeds 0 to N-1 (default 20)")
    verify.add_argument(
        "--jobs",
        type=count_of("processes"),
        default=os.cpu_count() or 1,
        metavar="N",
        help="processes (default: one per core)",
    )


def _verify(args: argparse.Namespace) -> int:
    from evaluator.certify.verify import verify  # noqa: PLC0415 - only this command needs the engine

    packs, folder = parse_scenes(args.scenes, args.scenes_dir), args.scenes_dir or default_folder()
    kept = [] if args.all else still_proven(folder, packs, args.seeds)
    unchanged = {certificate.scene for certificate in kept}
    packs = [files for files in packs if files.scene_id not in unchanged]
    console, proven = wide_console(), list[SceneCertificate]()
    if not console.is_terminal:
        console.width = _TABLE_WIDTH
    if kept:
        console.print(f"{len(kept)} scenes are sound and unchanged; --all proves them again", highlight=False)
    bar = progress_bar(console)

    def done(certificate: SceneCertificate) -> None:
        bar.advance(task)
        proven.append(certificate)
        write_certificates(folder, [certificate])
        if not console.is_terminal:
            place = f"[{len(proven)}/{len(packs)}] scene {reference_of(certificate.scene)}"
            console.print(f"{place}: {'sound' if certificate.passed else 'NOT SOUND'}", markup=False)

    async def play() -> None:
        async with LocalHost(args.scenes_dir) as host:
            await verify(packs, args.seeds, args.jobs, host.base_url, done)

    engine = version("mujoco")
    file = file_for(folder, engine)
    try:
        with bar:
            task = bar.add_task("proving", total=len(packs))
            if packs:
                run_async(play)
    except KeyboardInterrupt:
        print(
            f"physment-eval: interrupted; the certificates of {len(proven)} scenes are in {file};"
            " the same command goes on with the others",
            file=sys.stderr,
        )
        return 130
    certificates = sorted([*kept, *proven], key=lambda one: one.scene)
    _print_certificates(console, certificates)
    sound = sum(one.passed for one in certificates)
    found = f"{sound} of {len(certificates)} scenes are sound on MuJoCo {engine}   certificates: {file}"
    console.print(found, soft_wrap=True, highlight=False)
    return 0 if sound == len(certificates) else 1


def _print_certificates(console: Console, certificates: list[SceneCertificate]) -> None:
    table = Table(box=None, pad_edge=False)
    table.add_column("scene", justify="right")
    made = {check.name for one in certificates for check in one.checks}
    further = [name for name in (*PREDICTION_CERTIFICATES, *CATCH_CERTIFICATES, *FAMILY_CERTIFICATES) if name in made]
    titles = [*CERTIFICATES, *further]
    for title in titles:
        table.add_column(title, justify="center")
    for title in ("engine gap", "answer gap", "interventions", "iterations"):
        table.add_column(title, justify="right")
    for one in certificates:
        checks = {check.name: check for check in one.checks}
        key, difficulty = checks["key"].figures, checks["difficulty"].figures
        table.add_row(
            reference_of(one.scene),
            *(_mark(checks.get(name)) for name in titles),
            _percent(key.get("theory_engine_gap")),
            _percent(key.get("answer_gap")),
            str(difficulty.get("interventions", "")),
            str(difficulty.get("iterations", "")),
        )
    console.print(table)
    for one in certificates:
        for check in one.checks:
            for reason in check.reasons:
                console.print(Text(f"scene {reference_of(one.scene)}, {check.name}: {reason}", "red"), soft_wrap=True)


def _mark(check: Check | None) -> str:
    if check is None:
        return ""
    return "[green]✓[/]" if check.passed else "[red]✗[/]"


def _percent(share: object) -> str:
    return f"{share:.2%}" if isinstance(share, float) else ""


def _lint(args: argparse.Namespace) -> int:
    from evaluator.certify.lint import lint  # noqa: PLC0415 - only this command needs the engine

    console, packs = Console(), parse_scenes(args.scenes, args.scenes_dir)
    faulty = to_lay_out = 0
    for files in packs:
        layout_faults, layout_notes = _layout(files, fix=args.fix)
        faults = [*layout_faults, *lint(files)]
        for sentence in (*layout_notes, *faults):
            console.print(Text(f"scene {reference_of(files.scene_id)}: {sentence}"), soft_wrap=True)
        faulty += bool(faults)
        to_lay_out += bool(layout_notes) and not args.fix
    malformed = _errata_fault(args.scenes_dir or default_folder())
    if malformed:
        console.print(Text(malformed), soft_wrap=True)
    console.print(f"{len(packs) - faulty} of {len(packs)} scenes without fault", highlight=False)
    if to_lay_out:
        folder = "" if args.scenes_dir is None else f" --scenes-dir {args.scenes_dir}"
        sentence = f"{to_lay_out} not laid out; run: physment-eval lint --fix{folder}"
        console.print(sentence, markup=False, highlight=False, soft_wrap=True)
    return 1 if faulty or malformed else 0


def _errata_fault(folder: Path) -> str:
    """Describe what is wrong with the errata of a folder; empty if nothing is."""
    try:
        read_errata(folder)
    except PackError as error:
        return str(error)
    return ""


def _layout(files: PackFiles, *, fix: bool) -> tuple[list[str], list[str]]:
    """Check the formatting of a pack's files, or reformat them.

    Returns:
        Faults, if the files cannot be reformatted; and a note for each file that was not formatted.
    """
    try:
        found = lay_out(files) if fix else not_laid_out(files)
    except PackError as error:
        return [str(error)] if fix else [], []
    return [], [f"{file.name} {'is laid out now' if fix else 'is not laid out'}" for file in found]
