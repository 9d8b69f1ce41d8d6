"""`physment-eval [run]`: play the matrix, grade it, write the report."""

import argparse
import contextlib
import os
import sys
from collections.abc import AsyncGenerator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from rich.console import Console

from evaluator.answers.keys import KeyRing
from evaluator.commands.base import Commands, unwrapped
from evaluator.commands.results import finish
from evaluator.commands.run_options import add_options, limits_of, plan_of, shard_of, team_of
from evaluator.commands.terminal import ProgressDisplay
from evaluator.episode.connect import Laboratory, connect
from evaluator.episode.contender import Contender
from evaluator.errors import InfrastructureError, UsageError
from evaluator.records import EpisodeKey, Plan, RunRecord, ServerRecord
from evaluator.store import RunFolder
from evaluator.study.attempts import Play, play_key
from evaluator.study.contenders import Team
from evaluator.study.estimate import estimate_lines
from evaluator.study.limits import Meter
from evaluator.study.provenance import run_record, server_record
from evaluator.study.ray_executor import ray_workers, require_ray
from evaluator.study.runner import Runner, missing
from evaluator.study.selection import parse_scenes
from evaluator.study.shards import WHOLE, Shard
from evaluator.study.tally import Tally
from scenes import PackFiles


def add(commands: Commands, description: str) -> None:
    """Declare `run`.

    Args:
        commands: Where.
        description: Help of `run`, the default command: that of the whole program.
    """
    run = commands.add_parser(
        "run",
        help="play episodes (the default)",
        description=description,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    run.set_defaults(run=_run)
    add_options(run)


@dataclass(frozen=True, slots=True)
class _Study:
    """A run, ready to be played."""

    args: argparse.Namespace
    team: Team
    contenders: Mapping[str, Contender]
    packs: list[PackFiles]
    plan: Plan
    shard: Shard

    def keys(self) -> list[EpisodeKey]:
        return [key for key in self.plan.matrix() if self.shard.takes(key)]


def _run(args: argparse.Namespace) -> int:
    packs, team = parse_scenes(args.scenes, args.scenes_dir), team_of(args)
    contenders = team.build()
    plan, shard = plan_of(args, packs, tuple(contenders)), shard_of(args, os.environ)
    study = _Study(args, team, contenders, packs, plan, shard)
    if args.dry_run:
        for line in estimate_lines(plan, study.keys(), shard, args.concurrency):
            print(line)
        return 0
    if args.executor == "ray":
        require_ray()
    folder = _folder(args, contenders, shard)
    folder.create(resume=args.resume)
    keys, console = KeyRing(args.scenes_dir), Console(stderr=args.json)
    meter = Meter(limits_of(args))
    stopped, again = "", f"go on with the same options, --out {args.out or folder.path} --resume"

    async def play() -> None:
        nonlocal stopped
        with folder.held():
            stopped = await _play(study, folder, meter, keys, console)

    try:
        # A malformed pack or a missing key should show before hours of play, not after.
        for scene in plan.scenes:
            for seed in plan.seeds:
                keys.key(scene, seed)
        unwrapped(play)
    except UsageError:
        # Only an empty folder can be removed so: nothing is left of a run that never began.
        with contextlib.suppress(OSError):
            folder.path.rmdir()
        raise
    except KeyboardInterrupt:
        print(f"physment-eval: interrupted; {again}", file=sys.stderr)
        return 130
    if stopped:
        print(f"physment-eval: {stopped}; {again}", file=sys.stderr)
    return finish(folder, keys, console, as_json=args.json, wanted=len(study.keys()))


def _folder(args: argparse.Namespace, contenders: Mapping[str, Contender], shard: Shard) -> RunFolder:
    if args.resume and args.out is None:
        raise UsageError("--resume needs the folder of the run: --out DIR")
    if shard != WHOLE and args.out is None:
        raise UsageError(f"shard {shard.index}/{shard.count} needs the folder of the whole run: --out DIR")
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S")
    label = "study" if len(contenders) > 1 else next(iter(contenders)).split(":")[0]
    whole = args.out or Path("runs") / f"{stamp}-{label}"
    return RunFolder(whole if shard == WHOLE else whole / shard.name)


async def _play(study: _Study, folder: RunFolder, meter: Meter, keys: KeyRing, console: Console) -> str:
    """Play what is missing; returns why some of it was not."""
    args = study.args
    async with contextlib.AsyncExitStack() as stack:
        laboratory = await stack.enter_async_context(connect(args.server, args.scenes_dir))
        for contender in study.contenders.values():
            await stack.enter_async_context(contender.running())
        server = await _server(laboratory, study.plan, args.server)
        agents = {name: contender.facts() for name, contender in study.contenders.items()}
        shard = None if study.shard == WHOLE else f"{study.shard.index}/{study.shard.count}"
        record = run_record(study.plan, study.packs, server, agents, shard)
        play = await stack.enter_async_context(_executor(study, record.packs))
        folder.write_run(_continued(folder, record))
        done = folder.episodes()
        meter.add_all(one.usage for one in done.values())
        todo = missing(study.keys(), done)
        with ProgressDisplay(console, len(todo), Tally(keys, meter)) as display:
            runner = Runner(
                laboratory,
                study.contenders,
                folder,
                record.versions_of,
                args.concurrency,
                meter,
                args.episode_timeout,
                display.started,
                display.ended,
                play,
            )
            return await runner.run(todo)


@contextlib.asynccontextmanager
async def _executor(study: _Study, packs: Mapping[str, str]) -> AsyncGenerator[Play]:
    """What plays the episodes, as `--executor` says.

    Args:
        study: The run.
        packs: Scene → hash of its pack.
    """
    if study.args.executor == "local":
        yield play_key
        return
    async with ray_workers(study.team, study.contenders, packs, study.args.concurrency) as play:
        yield play


async def _server(laboratory: Laboratory, plan: Plan, option: str) -> ServerRecord:
    """What the server says about itself; asking shows early whether there is one."""
    try:
        async with laboratory.open(plan.scenes[0], plan.seeds[0]) as client:
            return await server_record(client, option)
    except InfrastructureError as error:
        raise UsageError(str(error)) from error


def _continued(folder: RunFolder, record: RunRecord) -> RunRecord:
    """The record to write: that of a new run, or the stored one with another start.

    Raises:
        UsageError: The stored run has another plan, agents, packs or shard, so the results would not belong together.
    """
    if not folder.run_file.exists():
        return record
    stored = folder.read_run()
    name = stored.difference(record) or ("shard" if stored.shard != record.shard else "")
    if name:
        raise UsageError(
            f"{folder.path} holds a run with other {name}; --resume needs the same, or choose another --out"
        )
    return stored.model_copy(update={"resumed": (*stored.resumed, record.start())})
