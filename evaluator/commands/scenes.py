"""`physment-eval scenes list|show|new|pages`: lists scenes, shows one, creates one, writes pages about all."""

import argparse
import os
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from evaluator.calibration.adaptive import StatedDifficulty, stated_difficulties
from evaluator.certify.records import SceneCertificate, engine_note, read_certificates
from evaluator.commands.base import (
    PROMPTINGS,
    PROTOCOLS,
    Commands,
    count_of,
    file_to_write,
    folder_to_write,
    scene_id,
    seed,
    wide_console,
)
from evaluator.errors import UsageError
from evaluator.scores.grouping import NO_RUNG
from evaluator.study.selection import find_split, parse_scenes, scenes_in_split
from scenes import (
    Category,
    Pack,
    PackError,
    PackFiles,
    Rung,
    default_folder,
    draw_knobs,
    drawn_mjcf,
    find_pack,
    is_world,
    read_pack,
    reference_of,
    same_pack,
    write_new_scene,
)
from scenes.model import noise_of_seed
from scenes.splits import splits

_WIDE = 120
"""Smallest width of a terminal at which the list has all its columns [characters]."""
_DESCRIPTION = """\
List the scenes, show one, start a new one, or write the pages about them.
"""
_LIST = """\
A line for each scene, and how many scenes each rung has. With --html, also a page with a card for each scene.
"""
_PAGES = """\
Write what the documentation says of the scenes: reference/scenes.md with a picture of each scene, a page of each in
reference/scenes, and explanation/worked-examples.md with a run of one scene of each category. The first two tell no
answers, hidden values or methods; the last tells the methods of its scenes.

This runs the solution.py of each scene: name only folders you trust. Pictures need a library that draws off-screen,
such as libosmesa6; without one the pages say so. Exit code: 0 written; 1 written, but something is wrong with a scene.
"""


def add(commands: Commands) -> None:
    """Declare the commands `scenes list`, `scenes show`, `scenes new` and `scenes pages`."""
    family = commands.add_parser("scenes", description=_DESCRIPTION)
    actions = family.add_subparsers(dest="action", metavar="list|show|new|pages", required=True)
    listing = actions.add_parser("list", help="a line for each scene", description=_LIST)
    listing.set_defaults(run=_list)
    listing.add_argument("--scenes", metavar="SEL", help="such as 7-111 · 7,9 · open · category:easy-single")
    listing.add_argument("--split", metavar="NAME", help=f"the scenes of a split: {' · '.join(splits())}")
    listing.add_argument(
        "--html",
        type=file_to_write,
        metavar="FILE",
        help="also write one page: a card with a picture for each, and filters",
    )
    listing.add_argument(
        "--link",
        metavar="ADDRESS",
        help="where the cards lead, with {scene} for the number (default: docs/reference/scenes, if there)",
    )
    show = _add_show(actions)
    new = actions.add_parser(
        "new",
        help="write a small working scene to start from",
        description="Write a small working scene, which lints and verifies, to start from: Scene{N} in --scenes-dir.",
    )
    new.set_defaults(run=_new)
    new.add_argument("scene", type=scene_id, metavar="N", help="id of the new scene, such as 112")
    new.add_argument("--category", required=True, choices=[one.value for one in Category], help="what kind of scene")
    pages = _add_pages(actions)
    for command in (listing, show, pages):
        command.add_argument(
            "--scenes-dir", type=Path, metavar="DIR", help="folder of scene packs (default: the suite)"
        )
    new.add_argument("--scenes-dir", type=Path, required=True, metavar="DIR", help="your folder of scene packs")


def _add_show(actions: Commands) -> argparse.ArgumentParser:
    show = actions.add_parser(
        "show",
        help="what an agent is told of a scene",
        description="Print the opening prompt of a scene, as an agent of `run` gets it with the same options.",
    )
    show.set_defaults(run=_show)
    show.add_argument("scene", type=scene_id, metavar="N", help="id of the scene")
    show.add_argument("--seed", type=seed, default=0, metavar="S", help="variant (default 0)")
    show.add_argument("--prompting", choices=PROMPTINGS, default=PROMPTINGS[0], help="as in run (default %(default)s)")
    show.add_argument("--protocol", choices=PROTOCOLS, default=PROTOCOLS[0], help="as in run (default %(default)s)")
    show.add_argument(
        "--budget", type=count_of("iterations"), default=20, metavar="N", help="iterations (default %(default)s)"
    )
    show.add_argument(
        "--private", action="store_true", help="also what no agent may know: hidden values, key, why, how"
    )
    return show


def _add_pages(actions: Commands) -> argparse.ArgumentParser:
    pages = actions.add_parser(
        "pages",
        help="write the documentation of the scenes, with pictures",
        description=_PAGES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    pages.set_defaults(run=_pages)
    pages.add_argument(
        "--out", type=folder_to_write, default=Path("docs"), metavar="DIR", help="where to (default docs)"
    )
    pages.add_argument("--no-pictures", action="store_true", help="draw nothing; the page says so")
    pages.add_argument(
        "--jobs",
        type=count_of("processes"),
        default=os.cpu_count() or 1,
        metavar="N",
        help="processes (default: one per core)",
    )
    return pages


def _list(args: argparse.Namespace) -> int:
    if args.link is not None and not args.html:
        raise UsageError("--link belongs to --html: give a FILE too")
    if args.link is not None and "{scene}" not in args.link:
        raise UsageError(
            "--link holds {scene} where the number of a scene belongs, as in site/reference/scenes/scene{scene}.html"
        )
    split = find_split(args.split) if args.split else None
    packs = (
        scenes_in_split(split, args.scenes, args.scenes_dir) if split else parse_scenes(args.scenes, args.scenes_dir)
    )
    folder = args.scenes_dir or default_folder()
    stored = read_certificates(folder, version("mujoco")) or read_certificates(folder)
    certificates = {one.scene: one for one in stored.scenes} if stored else {}
    certificate = f"certificate on MuJoCo {stored.engine}" if stored else "certificate"
    difficulties = stated_difficulties(packs)
    read = {files: _read(files) for files in packs}
    states = {files: _state(files, certificates.get(files.scene_id)) for files in packs}
    console = wide_console()
    rows = {files: (pack, difficulties.get(files.scene_id), states[files]) for files, pack in read.items()}
    console.print(_scene_table(rows, certificate, narrow=console.width < _WIDE))
    if console.width < _WIDE:
        console.print("a wider terminal also shows type and certificate", highlight=False)
    if note := engine_note(folder):
        console.print(note, highlight=False, soft_wrap=True)
    if difficulties:
        note = "difficulty ± standard error in logits, from answers of simulated takers; 0 is the average scene"
        console.print(note, highlight=False, soft_wrap=True)
    rungs: dict[str, list[str]] = {name: [] for name in (*Rung, NO_RUNG)}
    for files, pack in read.items():
        rungs[pack.category.rung.value if pack.category else NO_RUNG].append(states[files])
    console.print(_totals(rungs), highlight=False, soft_wrap=True)
    if split:
        seeds = f"{split.seeds[0]}-{split.seeds[-1]}"
        console.print(f"split {split.label}: {len(packs)} scenes, seeds {seeds}", highlight=False)
    if args.html:
        from evaluator.pages.pictures import write_gallery  # noqa: PLC0415 - only this option needs templates

        stated = {scene: _difficulty(one) for scene, one in difficulties.items()}
        write_gallery(read, args.html, args.link, args.scenes_dir, stated)
        console.print(f"{args.html} has a card for each", highlight=False, markup=False, soft_wrap=True)
    return 0


def _scene_table(
    rows: Mapping[PackFiles, tuple[Pack, StatedDifficulty | None, str]], certificate: str, *, narrow: bool
) -> Table:
    """Table with a row for each scene.

    Args:
        rows: Files of a pack → the pack, its difficulty, and the state of its certificate.
        certificate: Title of the last column.
        narrow: Whether to leave out columns, so that no word is broken in 80 columns. The category contains the rung.
    """
    titles = ("scene", "name", "rung", "category", "type", "answer", "difficulty", certificate)
    left_out = {"rung", "type", certificate} if narrow else set[str]()
    table = Table(box=None, pad_edge=False)
    for title in titles:
        if title not in left_out:
            justify = "right" if title == "scene" else "left"
            table.add_column(title, overflow="fold", justify=justify, no_wrap=title == "category")
    for files, (pack, difficulty, state) in rows.items():
        cells = (
            reference_of(files.scene_id),
            escape(pack.metadata.scene_name),
            pack.category.rung.value if pack.category else NO_RUNG,
            pack.category.value if pack.category else "",
            pack.metadata.problem_type,
            escape(_answer_type(pack)),
            _difficulty(difficulty),
            state,
        )
        table.add_row(*(cell for title, cell in zip(titles, cells, strict=True) if title not in left_out))
    return table


def _difficulty(stated: StatedDifficulty | None) -> str:
    return "" if stated is None else f"{stated.figure}, {stated.word}"


def _totals(states: Mapping[str, Sequence[str]]) -> str:
    """Format the number of scenes and of certified scenes on each rung.

    Args:
        states: Rung → states of its scenes' certificates.
    """
    parts = [
        f"{rung} {len(found)} ({sum(state.startswith('sound') for state in found)} sound)"
        for rung, found in states.items()
        if found
    ]
    return "scenes by rung  " + "   ".join(parts)


def _answer_type(pack: Pack) -> str:
    spec = pack.answer_spec
    if spec is None:
        return ""
    unit = ", ".join(spec.unit) if isinstance(spec.unit, tuple) else spec.unit
    named = f"{spec.kind.value} [{unit}]" if unit else spec.kind.value
    return " / ".join(spec.options) if spec.options else named


def _state(files: PackFiles, certificate: SceneCertificate | None) -> str:
    if certificate is None:
        return "none"
    if not same_pack(certificate.pack, files):
        return "changed since"
    return f"sound on {certificate.seeds} seeds" if certificate.passed else "not sound"


def _show(args: argparse.Namespace) -> int:
    from evaluator.answers.engine import prompt_of  # noqa: PLC0415 - only this command needs the engine
    from evaluator.certify.subject import Subject  # noqa: PLC0415 - as above

    console = Console()
    try:
        files = find_pack(args.scene, args.scenes_dir)
        pack = read_pack(files)
        knobs = draw_knobs(files, pack, args.seed)
        mjcf = noise_of_seed(drawn_mjcf(files, pack, knobs, canonical=args.seed == 0), args.seed)
        prompt = prompt_of(files, mjcf, args.prompting, args.protocol, args.budget)
        console.print(prompt, markup=False, highlight=False, soft_wrap=True)
        if args.private and is_world(args.scene):
            console.rule("private")
            console.print(f"key at every seed: {pack.answer}\nlaw: {pack.metadata.description}", markup=False)
        elif args.private:
            subject = Subject.open(files)
            truth = subject.truth(subject.draw(args.seed))
            console.rule("private")
            console.print(f"key at seed {args.seed}: {truth}", markup=False)
            for name, value in knobs.items():
                meaning = pack.knobs[name].meaning if name in pack.knobs else f"= {pack.derive[name]}"
                console.print(f"{name} = {value}   {meaning}", markup=False)
            console.print(f"why: {pack.reasoning}\nhow: {pack.expected_behavior}", markup=False)
    except PackError as error:
        raise UsageError(str(error)) from error
    return 0


def _new(args: argparse.Namespace) -> int:
    try:
        folder = write_new_scene(args.scenes_dir, args.scene, Category(args.category))
    except PackError as error:
        raise UsageError(str(error)) from error
    Console().print(
        f"{folder} holds a small working scene. Make it yours, then:\n"
        f"  physment-eval lint --scenes-dir {args.scenes_dir} --scene {args.scene}\n"
        f"  physment-eval verify --scenes-dir {args.scenes_dir} --scene {args.scene}",
        markup=False,
        highlight=False,
        soft_wrap=True,
    )
    return 0


def _pages(args: argparse.Namespace) -> int:
    from evaluator.pages.write import write_pages  # noqa: PLC0415 - only this command needs the engine

    def say(sentence: str) -> None:
        console.print(sentence, markup=False, highlight=False, soft_wrap=True)

    console = Console()
    packs = parse_scenes(None, args.scenes_dir)
    difficulties = {scene: one.sentence for scene, one in stated_difficulties(packs).items()}
    written = write_pages(packs, args.out, difficulties, pictures=not args.no_pictures, jobs=args.jobs, on_done=say)
    for sentence in (*written.faults, written.unpictured):
        if sentence:
            say(sentence)
    say(f"{len(written.files)} files are written in {args.out}")
    return 1 if written.faults else 0


def _read(files: PackFiles) -> Pack:
    try:
        return read_pack(files)
    except PackError as error:
        raise UsageError(str(error)) from error
