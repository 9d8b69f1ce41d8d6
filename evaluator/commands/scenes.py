"""`physment-eval scenes list|show|new`: what scenes there are, what one is, and the start of a new one."""

import argparse
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from evaluator.certify.records import SceneCertificate, read_certificates
from evaluator.commands.base import Commands, whole, wide_console
from evaluator.errors import UsageError
from evaluator.new_scene import write_new_scene
from evaluator.runner import pack_hash
from evaluator.selection import parse_scenes
from scenes import Category, Pack, PackError, PackFiles, default_folder, draw_knobs, drawn_mjcf, find_pack, read_pack

_DESCRIPTION = """\
List the scenes, show one, or start a new one.
"""


def add(commands: Commands) -> None:
    """Declare `scenes list`, `scenes show` and `scenes new`."""
    family = commands.add_parser("scenes", help="list, show, or start scenes", description=_DESCRIPTION)
    actions = family.add_subparsers(dest="action", metavar="list|show|new", required=True)
    listing = actions.add_parser("list", help="a line for each scene", description="A line for each scene.")
    listing.set_defaults(run=_list)
    listing.add_argument("--scenes", metavar="SEL", help="such as 7-111 · 7,9 · category:easy-single")
    show = actions.add_parser(
        "show", help="what an agent is told of a scene", description="Print the opening prompt of a scene."
    )
    show.set_defaults(run=_show)
    show.add_argument("scene", type=whole, metavar="N", help="id of the scene")
    show.add_argument("--seed", type=int, default=0, metavar="S", help="variant (default 0)")
    show.add_argument(
        "--private", action="store_true", help="also what no agent may know: hidden values, key, why, how"
    )
    new = actions.add_parser(
        "new",
        help="write a small working scene to start from",
        description="Write a small working scene, which lints and verifies, to start from: Scene{N} in --scenes-dir.",
    )
    new.set_defaults(run=_new)
    new.add_argument("scene", type=whole, metavar="N", help="id of the new scene, such as 112")
    new.add_argument("--category", required=True, choices=[one.value for one in Category], help="one of the 13")
    for command in (listing, show):
        command.add_argument(
            "--scenes-dir", type=Path, metavar="DIR", help="folder of scene packs (default: the suite)"
        )
    new.add_argument("--scenes-dir", type=Path, required=True, metavar="DIR", help="your folder of scene packs")


def _list(args: argparse.Namespace) -> int:
    packs = parse_scenes(args.scenes, args.scenes_dir)
    stored = read_certificates(args.scenes_dir or default_folder())
    certificates = {one.scene: one for one in stored.scenes} if stored else {}
    table = Table(box=None, pad_edge=False)
    table.add_column("scene", justify="right")
    for title in ("name", "category", "type", "answer", "certificate"):
        table.add_column(title, overflow="fold")
    for files in packs:
        pack = _read(files)
        table.add_row(
            str(files.scene_id),
            escape(pack.metadata.scene_name),
            pack.category.value if pack.category else "",
            pack.metadata.problem_type,
            escape(_answer_type(pack)),
            _state(files, certificates.get(files.scene_id)),
        )
    wide_console().print(table)
    return 0


def _answer_type(pack: Pack) -> str:
    spec = pack.answer_spec
    if spec is None:
        return ""
    unit = ", ".join(spec.unit) if isinstance(spec.unit, tuple) else spec.unit
    return " / ".join(spec.options) if spec.options else f"{spec.kind.value} [{unit}]"


def _state(files: PackFiles, certificate: SceneCertificate | None) -> str:
    if certificate is None:
        return "none"
    if certificate.pack != pack_hash(files):
        return "changed since"
    return f"sound on {certificate.seeds} seeds" if certificate.passed else "not sound"


def _show(args: argparse.Namespace) -> int:
    from evaluator.certify.engine import prompt_of  # noqa: PLC0415 - only this command needs the engine
    from evaluator.certify.subject import Subject  # noqa: PLC0415 - as above

    console = Console()
    try:
        files = find_pack(args.scene, args.scenes_dir)
        pack = read_pack(files)
        knobs = draw_knobs(files, pack, args.seed)
        mjcf = drawn_mjcf(files, pack, knobs, canonical=args.seed == 0)
        console.print(prompt_of(files, mjcf), markup=False, highlight=False)
        if args.private:
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
    folder = write_new_scene(args.scenes_dir, args.scene, Category(args.category))
    Console().print(
        f"{folder} holds a small working scene. Make it yours, then:\n"
        f"  physment-eval lint --scenes-dir {args.scenes_dir} --scene {args.scene}\n"
        f"  physment-eval verify --scenes-dir {args.scenes_dir} --scene {args.scene}",
        markup=False,
        highlight=False,
        soft_wrap=True,
    )
    return 0


def _read(files: PackFiles) -> Pack:
    try:
        return read_pack(files)
    except PackError as error:
        raise UsageError(str(error)) from error
