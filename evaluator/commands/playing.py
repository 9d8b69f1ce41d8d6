"""Plays a prepared run, grades it, writes its report, and exports its spans (`--otel`). Used by `run` and `fork`."""

import contextlib
import functools
import os
import sys
from collections.abc import AsyncGenerator, Generator, Mapping
from dataclasses import dataclass, replace
from importlib import import_module, metadata, util

from opentelemetry.trace import set_tracer_provider
from rich.console import Console

from evaluator.answers.keys import KeyRing
from evaluator.calibration.adaptive import DifficultyTable
from evaluator.commands.adaptive import play_adaptively
from evaluator.commands.base import run_async, usual_folder
from evaluator.commands.finishing import finish
from evaluator.commands.terminal import ProgressDisplay, Tally
from evaluator.episode.connect import EpisodeConnector, connect
from evaluator.episode.hosts import HostConnector
from evaluator.episode.loop import Participant
from evaluator.errors import InfrastructureError, UsageError
from evaluator.records.episode import EpisodeKey
from evaluator.records.run import ForkedRun, Plan, RunRecord, SeedProofs
from evaluator.store.redaction import Redaction
from evaluator.store.run_folder import RunFolder
from evaluator.study.integrity import Sealing, played_worlds
from evaluator.study.meter import Meter
from evaluator.study.process_executor import process_workers, usual_workers
from evaluator.study.ray_executor import ray_workers
from evaluator.study.run_config import RunConfig
from evaluator.study.run_start import continued, run_record, server_record
from evaluator.study.runner import LocalPlay, Play, Runner, missing
from evaluator.study.shards import WHOLE
from scenes import ErratumEffect


@dataclass(frozen=True, slots=True)
class PreparedRun:
    """The configuration, participants and episode keys of a run that has not been played yet."""

    config: RunConfig
    participants: Mapping[str, Participant]
    plan: Plan
    keys: list[EpisodeKey]
    """Keys of the episodes of this shard."""
    folder: RunFolder
    answers: KeyRing
    meter: Meter
    console: Console
    forked_from: ForkedRun | None = None
    """The run whose episodes are continued; None if they are played from their start."""
    seed_proofs: SeedProofs | None = None
    """Results of the proofs of seeds that no certificate covers; None if no proofs were requested."""
    table: DifficultyTable | None = None
    """Difficulties of the scenes for an adaptive test; None to play all keys."""


def play_run(run: PreparedRun) -> int:
    """Play the missing episodes, grade the run and write the report; returns the exit code."""
    config, folder = run.config, run.folder
    continuation = f"to continue, give the same options with --out {config.out or folder.path} --resume"
    try:
        stopped = _play(run)
    except KeyboardInterrupt:
        print(f"physment-eval: interrupted; {continuation}", file=sys.stderr)
        return 130
    if stopped:
        print(f"physment-eval: {stopped}; {continuation}", file=sys.stderr)
    wanted = len(run.keys) if run.table is None else None
    code = finish(folder, run.answers, run.console, as_json=config.as_json, wanted=wanted, keep_laws=True)
    return code or int(bool(stopped))


def create_folder(config: RunConfig, participants: Mapping[str, Participant]) -> RunFolder:
    """Create the folder of a new run, or open that of a resumed one.

    Raises:
        UsageError: `--out` is required and missing.
        StoreError: The folder cannot be written, or holds a run already.
    """
    shard = config.shard
    if config.resume and config.out is None:
        raise UsageError("--resume needs the folder of the run: --out DIR")
    if shard != WHOLE and config.out is None:
        raise UsageError(f"shard {shard.index}/{shard.count} needs the folder of the whole run: --out DIR")
    label = "study" if len(participants) > 1 else next(iter(participants)).split(":")[0]
    whole = config.out or usual_folder(label)
    folder = RunFolder(whole if shard == WHOLE else whole / shard.name)
    folder.create(resume=config.resume)
    return folder


def _play(run: PreparedRun) -> str:
    """Play the missing episodes.

    Returns:
        Why some episodes were not played, as a clause; empty if all were.
    """
    try:
        # Report a malformed pack or a missing answer key now, not after hours of play.
        for scene, seed in dict.fromkeys((key.scene, key.seed) for key in run.keys):
            run.answers.key(scene, seed)
        return run_async(functools.partial(_play_missing, run))
    except UsageError:
        # rmdir removes only an empty folder, so only a run that never started is deleted.
        with contextlib.suppress(OSError):
            run.folder.path.rmdir()
        raise


async def _play_missing(run: PreparedRun) -> str:
    config, folder = run.config, run.folder
    async with contextlib.AsyncExitStack() as stack:
        stack.enter_context(folder.held())
        if config.otel:
            stack.enter_context(exporting_spans())
        damage = folder.set_damage_aside() if config.resume else []
        for note in damage:
            print(f"physment-eval: {note}", file=sys.stderr)
        sealing = Sealing(folder, trust=config.allow_modified, damage=damage)
        laboratory = await stack.enter_async_context(
            connect(config.server, config.scenes_dir, config.observations, config.seed_of)
        )
        folder = replace(folder, redaction=_redaction(laboratory), on_line=sealing.add)
        for participant in run.participants.values():
            await stack.enter_async_context(participant.running())
        record = await _record(run, laboratory)
        for entry in filter(None, map(run.answers.erratum, record.packs.values())):
            if entry.effect is ErratumEffect.WITHDRAWN:
                note = f"episodes of scene {entry.scene} will be unscored, because its pack is withdrawn: {entry.fault}"
                print(f"physment-eval: {note}", file=sys.stderr)
        play = await stack.enter_async_context(_executor(run, laboratory, record))
        folder.write_run(continued(folder, record, config.packs))
        stack.callback(_seal, folder, sealing, run.console)
        done = folder.episodes()
        run.meter.add_all(episode.usage for episode in done.values())
        todo = missing(run.keys, done)
        display = stack.enter_context(
            ProgressDisplay(run.console, len(todo), Tally(run.answers, run.meter, run.plan.agents))
        )
        runner = Runner(
            play=play,
            folder=folder,
            concurrency=config.concurrency,
            meter=run.meter,
            on_start=display.started,
            on_end=display.ended,
        )
        if run.table is not None:
            return await play_adaptively(config, run.table, runner, run.keys, done, run.answers)
        return await runner.run(todo)


def _redaction(laboratory: EpisodeConnector) -> Redaction:
    """The redaction that is applied to all records. It removes API keys of the providers and the token of the host."""
    token = laboratory.token if isinstance(laboratory, HostConnector) else None
    return Redaction.of(os.environ, {"host token": token} if token else {})


def _seal(folder: RunFolder, sealing: Sealing, console: Console) -> None:
    """Write the seal, and print it so that the operator can store it elsewhere."""
    folder.write_seal(sealing.seal)
    console.print(sealing.sentence(), highlight=False, soft_wrap=True)


async def _record(run: PreparedRun, laboratory: EpisodeConnector) -> RunRecord:
    """Create the record of a run that starts now. Queries the server, so that an unreachable server fails early."""
    plan, shard = run.plan, run.config.shard
    try:
        async with laboratory.open(plan.scenes[0], plan.seeds[0]) as client:
            server = await server_record(client, run.config.server)
    except InfrastructureError as error:
        raise UsageError(str(error)) from error
    agents = {name: participant.facts() for name, participant in run.participants.items()}
    part = None if shard == WHOLE else f"{shard.index}/{shard.count}"
    record = run_record(plan, run.config.packs, server, agents, part)
    worlds = played_worlds(run.config.packs, run.config.scenes_dir)
    known = {"forked_from": run.forked_from, "worlds": worlds, "seed_proofs": run.seed_proofs}
    return record.model_copy(update=known)


@contextlib.asynccontextmanager
async def _executor(run: PreparedRun, laboratory: EpisodeConnector, record: RunRecord) -> AsyncGenerator[Play]:
    """Return the function that plays an episode: in this process, or on the workers of `--executor` and `--workers`."""
    config = run.config
    count = config.workers or usual_workers(config, len(run.keys))
    if config.executor == "local" and count == 1:
        yield LocalPlay(laboratory, run.participants, record.versions_of, config.episode_timeout_s)
        return
    start = ray_workers if config.executor == "ray" else functools.partial(process_workers, count=count)
    async with start(config, run.participants, record) as play:
        yield play


EXTRA = "physment-mcp[otel]"


def require_otel() -> None:
    """Check that the exporter is installed, without importing it.

    Raises:
        UsageError: The exporter is not installed.
    """
    names = ("opentelemetry.sdk", "opentelemetry.exporter.otlp.proto.http")
    try:
        found = all(util.find_spec(name) is not None for name in names)
    except ModuleNotFoundError:
        found = False
    if not found:
        raise UsageError(
            f"--otel needs the SDK and the exporter of OpenTelemetry, which are not installed: pip install '{EXTRA}'"
        )


@contextlib.contextmanager
def exporting_spans() -> Generator[None]:
    """Export spans while the context is open; flush them when it closes.

    The `OTEL_…` environment variables of OpenTelemetry configure endpoint, headers and sampling.
    """
    require_otel()
    sdk, export = import_module("opentelemetry.sdk.trace"), import_module("opentelemetry.sdk.trace.export")
    resource = import_module("opentelemetry.sdk.resources").Resource
    exporter = import_module("opentelemetry.exporter.otlp.proto.http.trace_exporter").OTLPSpanExporter
    described = resource.create({"service.name": "physment-eval", "service.version": metadata.version("physment-mcp")})
    provider = sdk.TracerProvider(resource=described)
    provider.add_span_processor(export.BatchSpanProcessor(exporter()))
    set_tracer_provider(provider)
    try:
        yield
    finally:
        provider.shutdown()
