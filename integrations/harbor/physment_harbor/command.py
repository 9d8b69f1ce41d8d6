"""`physment-eval harbor write|grade`: writes variants as Harbor tasks, and grades an episode that Harbor played."""

import argparse
import json
from pathlib import Path

import anyio
from pydantic import BaseModel, ConfigDict, ValidationError

from evaluator import Outcome, UsageError, Verdict, connect, episode_of_log, grade, select
from physment_harbor.tasks import rehearse, write_task

_DESCRIPTION = """\
Write variants as task folders of Harbor, or grade an episode that was played in one.

  physment-eval harbor write build/harbor --scenes 7-20 --seeds 1000
  harbor run -p build/harbor -a claude-code -m MODEL

docs/how-to/harbor.md says how this plugin is installed, which two images tasks need, and what the containers know.
"""


class TaskEpisode(BaseModel):
    """`episode.json`: the variant that the laboratory of a task opens and the verifier grades."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    scene: int
    seed: int
    max_calls: int


def add(family: argparse.ArgumentParser) -> None:
    """Declare `harbor write` and `harbor grade`.

    Args:
        family: The parser of `physment-eval harbor`.
    """
    family.description, family.formatter_class = _DESCRIPTION, argparse.RawDescriptionHelpFormatter
    actions = family.add_subparsers(dest="action", metavar="write|grade", required=True)
    write = actions.add_parser(
        "write",
        help="write a task folder for each variant",
        description="Write a task folder of Harbor for each variant: DIR/scene7-1 for the first seed of scene 7, and so"
        " on. The reference protocol plays each first; a variant that it does not solve is left out. Exit code: 0 all"
        " are written; 1 some are left out.",
    )
    write.set_defaults(run=_write)
    write.add_argument("folder", type=Path, metavar="DIR", help="folder for the folders of the tasks")
    write.add_argument(
        "--scenes", metavar="SEL", help="such as 7-20 · easy · category:easy-single (default: the suite)"
    )
    write.add_argument("--seeds", metavar="N,…", help="variants of each scene, such as 0 or 1000-1004 (default 0)")
    write.add_argument(
        "--split",
        metavar="NAME",
        help="a split, among whose scenes and seeds the two others choose (by default all its scenes and its first 20"
        " seeds)",
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
    # Folders are numbered, because their names must not reveal the seed.
    variants = [
        (f"scene{files.scene_id}-{number}", files.scene_id, seed)
        for files in packs
        for number, seed in enumerate(seeds, start=1)
    ]
    try:
        args.folder.mkdir(parents=True, exist_ok=True)
        if any(args.folder.iterdir()):
            raise UsageError(f"{args.folder} is not an empty folder; name a new one")
    except OSError as error:
        raise UsageError(f"{args.folder} cannot be written: {error.strerror}") from error
    left_out = anyio.run(_write_all, args, variants)
    print(f"{len(variants) - left_out} tasks are written in {args.folder}")
    return 1 if left_out else 0


async def _write_all(args: argparse.Namespace, variants: list[tuple[str, int, int]]) -> int:
    """Write the tasks; returns the number of omitted variants."""
    left_out = 0
    async with connect("host", args.scenes_dir) as laboratory:
        for name, scene, seed in variants:
            try:
                rehearsal = await rehearse(laboratory, scene, seed, args.scenes_dir)
            except UsageError as error:
                print(error, flush=True)
                left_out += 1
            else:
                write_task(rehearsal, args.folder / name, args.scenes_dir)
    return left_out


def _grade(args: argparse.Namespace) -> int:
    print(json.dumps(rewards(args.log, args.episode, args.scenes_dir)))
    return 0


def rewards(log: Path, episode: Path, scenes_dir: Path | None) -> dict[str, float]:
    """Return the rewards of a task by name. Runs in a container to which no agent had access.

    Args:
        log: The call log of the laboratory, as a host publishes it.
        episode: The `episode.json` of the task.
        scenes_dir: Folder of complete packs; None for the suite.

    Returns:
        `reward` and `strict`: 1 if the answer is strictly correct, otherwise 0; `normalised`: the same by normalised
        grading; `graded`: the share of the answer's parts that are right; `answered`; `calls`.

    Raises:
        UsageError: A file cannot be read, or the scene has no key.
    """
    try:
        wanted = TaskEpisode.model_validate_json(episode.read_bytes())
    except (OSError, ValidationError) as error:
        said = error.strerror if isinstance(error, OSError) else error.errors()[0]["msg"]
        raise UsageError(f"{episode} is no episode.json of a task: {said}") from error
    try:
        calls = log.read_bytes()
    except OSError as error:
        raise UsageError(f"{log} is no log of calls: {error.strerror}; the laboratory wrote none") from error
    played = episode_of_log(calls, wanted.scene, seed=wanted.seed, max_calls=wanted.max_calls, scenes_dir=scenes_dir)
    found = grade(played, scenes_dir).grade
    strict = float(found.strict is Verdict.CORRECT)
    return {
        "reward": strict,
        "strict": strict,
        "normalised": float(found.normalised is Verdict.CORRECT),
        "graded": found.graded or 0.0,
        "answered": float(played.outcome is Outcome.ANSWERED),
        "calls": float(len(played.turns)),
    }
