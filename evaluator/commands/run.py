"""`physment-eval [run]`: play the matrix, grade it, write the report."""

import argparse
import sys
from collections import Counter
from collections.abc import Iterable, Iterator

from rich.console import Console

from evaluator.answers.keys import KeyRing
from evaluator.certify.records import engine_note
from evaluator.commands.base import Commands
from evaluator.commands.overview import DESCRIPTION
from evaluator.commands.playing import PreparedRun, create_folder, play_run
from evaluator.commands.run_options import add_options, read_options
from evaluator.commands.telemetry import require_otel
from evaluator.errors import UsageError
from evaluator.study.estimate import estimate_lines
from evaluator.study.participants import participants_of
from evaluator.study.ray_executor import require_ray
from evaluator.study.run_config import Meter
from scenes import USUAL_TIMESTEP_S, PackError, PackFiles, default_folder, timestep_of


def add(commands: Commands) -> None:
    """Declare `run`, the default command, which has the help text of the whole program."""
    run = commands.add_parser(
        "run",
        description=DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    run.set_defaults(run=_run)
    add_options(run)


def _run(args: argparse.Namespace) -> int:
    config = read_options(args)
    participants = participants_of(config)
    plan = config.plan(participants)
    keys = [key for key in plan.matrix() if config.shard.takes(key)]
    if config.dry_run:
        print(*estimate_lines(plan, keys, config.shard, config.concurrency), sep="\n")
        return 0
    if config.otel:
        if config.executor == "ray":
            raise UsageError("--otel: the workers of --executor ray export no spans; play with --executor local")
        require_otel()
    if config.executor == "ray":
        require_ray()
    for note in (*_timestep_notes(config.packs), engine_note(config.scenes_dir or default_folder())):
        if note:
            print(f"physment-eval: {note}", file=sys.stderr)
    folder = create_folder(config, participants)
    answers, console = KeyRing(config.scenes_dir, config.seed_of), Console(stderr=config.as_json)
    return play_run(PreparedRun(config, participants, plan, keys, folder, answers, Meter(config.limits), console))


def _timestep_notes(packs: Iterable[PackFiles]) -> Iterator[str]:
    """One note for each time step other than that of the paper and the suite.

    Raises:
        UsageError: A model cannot be read.
    """
    try:
        counts = Counter(timestep_of(files) for files in packs if files.mjcf.is_file())
    except PackError as error:
        raise UsageError(str(error)) from error
    for step, count in sorted(counts.items()):
        if step != USUAL_TIMESTEP_S:
            scenes = "1 scene runs" if count == 1 else f"{count} scenes run"
            command = f"physment-mcp --timestep {USUAL_TIMESTEP_S:g} --scenes-dir DIR --scene {{scene}} --seed {{seed}}"
            yield (
                f"{scenes} with the time step of the model, {step:g} s; the paper has {USUAL_TIMESTEP_S:g} s. To force"
                f" it: --server '{command}'"
            )
