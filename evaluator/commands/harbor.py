"""`physment-eval harbor write|grade`: variants as task folders of Harbor, and the reward of an episode played there."""

import argparse
import functools
import json
from pathlib import Path

from evaluator.answers.keys import KeyRing
from evaluator.commands.argument_types import folder_to_write
from evaluator.commands.base import Commands, run_async
from evaluator.episode.connect import HostLaboratory, connect
from evaluator.errors import UsageError
from evaluator.harbor.evidence import rewards
from evaluator.harbor.rehearsal import rehearse
from evaluator.harbor.tasks import write_task
from evaluator.study.selection import USUAL_SEEDS, select

_DESCRIPTION = """\
Write variants as task folders of Harbor, or grade an episode that was played in one.

  physment-eval harbor write build/harbor --scenes 7-20 --seeds 1000
  harbor run -p build/harbor -a claude-code -m MODEL

docs/how-to/harbor.md says which two images they need, and what the containers know.
"""


def add(commands: Commands) -> None:
    """Declare `harbor write` and `harbor grade`."""
    family = commands.add_parser(
        "harbor", description=_DESCRIPTION, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    actions = family.add_subparsers(dest="action", metavar="write|grade", required=True)
    write = actions.add_parser(
        "write",
        help="write a task folder for each variant",
        description="Write a task folder of Harbor for each variant: DIR/scene7-1 for the first seed of scene 7, and so"
        " on. The reference protocol plays each first; a variant that it does not solve is left out. Exit code: 0 all"
        " are written; 1 some are left out.",
    )
    write.set_defaults(run=_write)
    write.add_argument("folder", type=folder_to_write, metavar="DIR", help="folder for the folders of the tasks")
    write.add_argument(
        "--scenes", metavar="SEL", help="such as 7-20 · easy · category:easy-single (default: the suite)"
    )
    write.add_argument("--seeds", metavar="N,…", help="variants of each scene, such as 0 or 1000-1004 (default 0)")
    write.add_argument(
        "--split",
        metavar="NAME",
        help=f"a split, among whose scenes and seeds the two others choose (by default all its scenes and its first"
        f" {USUAL_SEEDS} seeds)",
    )
    grade = actions.add_parser(
        "grade",
        help="print the reward of an episode that was played in a task",
        description="Print the rewards of an episode as a line of JSON, from the log that the laboratory kept.",
    )
    grade.set_defaults(run=_grade)
    grade.add_argument("log", type=Path, metavar="LOG", help="the log of calls")
    grade.add_argument("--episode", type=Path, required=True, metavar="FILE", help="the episode.json of the task")
    for command in (write, grade):
        command.add_argument(
            "--scenes-dir", type=Path, metavar="DIR", help="folder of whole packs (default: the suite)"
        )


def _write(args: argparse.Namespace) -> int:
    _, packs, seeds = select(args.split, args.scenes, args.seeds, args.scenes_dir)
    # Numbered, because the name of a folder must not tell the seed.
    variants = [
        (f"scene{files.scene_id}-{number}", files.scene_id, seed)
        for files in packs
        for number, seed in enumerate(seeds, start=1)
    ]
    if args.folder.exists() and (not args.folder.is_dir() or any(args.folder.iterdir())):
        raise UsageError(f"{args.folder} is not an empty folder; name a new one")
    left_out = run_async(functools.partial(_write_all, args, variants))
    print(f"{len(variants) - left_out} tasks are written in {args.folder}")
    return 1 if left_out else 0


async def _write_all(args: argparse.Namespace, variants: list[tuple[str, int, int]]) -> int:
    """Write the tasks; returns how many are left out."""
    left_out = 0
    async with connect("host", args.scenes_dir) as host:
        assert isinstance(host, HostLaboratory)
        keys = KeyRing(args.scenes_dir)
        for name, scene, seed in variants:
            try:
                rehearsal = await rehearse(host, keys, scene, seed)
            except UsageError as error:
                print(error, flush=True)
                left_out += 1
            else:
                write_task(rehearsal, args.folder / name, args.scenes_dir)
    return left_out


def _grade(args: argparse.Namespace) -> int:
    print(json.dumps(rewards(args.log, args.episode, KeyRing(args.scenes_dir))))
    return 0
