"""Workers: processes that play episodes, on this machine or on a cluster, and the assignment of episodes to them.

The executors (`process_executor`, `ray_executor`) start workers and communicate with them. Workers do not write to
run folders: they return records to the process that the operator started, which writes them.
"""

import contextlib
import math
import os
import platform
from collections.abc import AsyncGenerator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Protocol

import anyio

from evaluator.episode.connect import EpisodeConnector, connect
from evaluator.episode.loop import Participant
from evaluator.errors import PermanentFailure, UsageError
from evaluator.records.episode import Episode, EpisodeKey, Versions
from evaluator.records.run import RunRecord
from evaluator.study.run_config import RunConfig, participants_of
from evaluator.study.runner import MAX_ATTEMPTS, Play, play_key, unplayed
from scenes import find_pack, reference_of, same_pack

VERSION = version("physment-mcp")
"""Version of this package; a run and its workers must have the same."""
_AGAIN_S = 0.5
"""Pause between attempts to prepare a lost worker [s]."""
_CLOSE_S = 5.0
"""Longest time for workers to close the servers that they started [s]."""


class WorkerLost(Exception):
    """A worker has ended, or cannot be reached."""


class Worker(Protocol):
    """A worker as seen by the run. The object stays the same when its process is restarted, also on another machine."""

    async def prepare(self) -> UsageError | None:
        """Prepare to play; returns a problem that only the operator can solve, or None.

        Raises:
            WorkerLost: The worker ended before it was ready. The call may be repeated.
        """
        ...

    async def play(
        self, key: EpisodeKey, versions: Versions, timeout_s: float | None
    ) -> Episode | PermanentFailure | UsageError:
        """Play one episode. Errors that affect further episodes are returned, not raised.

        Raises:
            WorkerLost: The worker ended before the episode did.
        """
        ...

    async def close(self) -> None:
        """Close the servers that the worker started.

        Raises:
            WorkerLost: The worker had ended already.
        """
        ...


@dataclass(frozen=True, slots=True)
class Crash:
    """An unexpected exception in a worker process, with its traceback.

    Pickled between processes, so it must not be defined in the module that the worker process runs as `__main__`.
    """

    trace: str


@dataclass(slots=True)
class EpisodeWorker:
    """The part of a worker inside its process: plays several episodes concurrently in its own laboratory."""

    config: RunConfig
    folder: Path
    """Working directory of the run, to which relative paths in options refer. Machines of a cluster share it."""
    version: str
    """Version of this package where the run was started."""
    packs: Mapping[str, str]
    """Scene → hash of its pack in the run's record; empty if a host that the run did not start holds the packs."""
    kind: str
    """Name of this kind of worker in error messages, such as `Ray worker`."""
    _participants: Mapping[str, Participant] = field(default_factory=dict[str, Participant])
    _laboratory: EpisodeConnector | None = None
    _open: contextlib.AsyncExitStack = field(default_factory=contextlib.AsyncExitStack)

    async def prepare(self) -> UsageError | None:
        """Prepare to play. A problem is returned and not raised, because Ray wraps raised errors."""
        if self._laboratory is not None:
            return None
        where = f"a {self.kind} on {platform.node()}"
        try:
            with contextlib.suppress(OSError):
                os.chdir(self.folder)
            if self.version != VERSION:
                return UsageError(f"{where} has version {VERSION}, not {self.version}")
            for scene, known in self.packs.items():
                if not same_pack(known, find_pack(int(scene), self.config.scenes_dir)):
                    return UsageError(f"{where} has another pack of scene {reference_of(int(scene))}")
            self._participants = participants_of(self.config)
            for participant in self._participants.values():
                await self._open.enter_async_context(participant.running())
            place = connect(self.config.server, self.config.scenes_dir, self.config.observations, self.config.seed_of)
            self._laboratory = await self._open.enter_async_context(place)
        except Exception as error:  # noqa: BLE001 - whatever a node lacks, the operator must learn which node it is
            return UsageError(f"{where} cannot play: {error}")
        return None

    async def play(
        self, key: EpisodeKey, versions: Versions, timeout_s: float | None
    ) -> Episode | PermanentFailure | UsageError:
        """Play one episode. Errors that affect further episodes are returned, not raised."""
        assert self._laboratory is not None
        try:
            return await play_key(self._participants[key.agent], self._laboratory, key, versions, timeout_s)
        except (PermanentFailure, UsageError) as error:
            return error

    async def close(self) -> None:
        """Close connections and the servers that this worker started."""
        await self._open.aclose()


@dataclass(slots=True, eq=False)
class WorkerSlot:
    """A worker, and the number of episodes that it can play concurrently."""

    worker: Worker
    places: int
    """Number of episodes that the worker plays at a time."""
    ready: bool = False
    life: int = 0
    """Number of times that the worker was lost. Free slots offered before the last loss are discarded."""


@dataclass(frozen=True, slots=True)
class Terms:
    """Settings shared by all episodes of a run."""

    record: RunRecord
    timeout_s: float | None
    """Time limit of one attempt, as wall time [s]; None for no limit."""
    patience_s: float
    """Longest time for a lost worker to restart [s]."""
    kind: str
    """Name of this kind of worker in error messages."""


class Workers:
    """Assigns episodes to workers. An episode whose worker was lost is played again."""

    def __init__(self, slots: Sequence[WorkerSlot], terms: Terms) -> None:
        self._slots = list(slots)
        self._terms = terms
        self._tasks = anyio.create_task_group()
        self._decided = anyio.Event()
        """Set when a worker is ready, or when none has become ready in time."""
        self._give, self._take = anyio.create_memory_object_stream[tuple[WorkerSlot, int]](math.inf)

    @contextlib.asynccontextmanager
    async def at_work(self) -> AsyncGenerator[Play]:
        """Prepare the workers, wait for the first to be ready, and close all of them on exit.

        Raises:
            UsageError: A worker has a problem that only the operator can solve.
        """
        with self._give, self._take:
            async with self._tasks:
                for slot in self._slots:
                    self._tasks.start_soon(self._wait_for, slot)
                await self._decided.wait()
                try:
                    yield self._play
                finally:
                    self._tasks.cancel_scope.cancel()
                    with anyio.move_on_after(_CLOSE_S, shield=True):
                        async with anyio.create_task_group() as closing:
                            for slot in self._slots:
                                if slot.ready:
                                    closing.start_soon(self._close, slot)

    async def _play(self, key: EpisodeKey) -> Episode:
        versions, kind = self._terms.record.versions_of(key.scene), self._terms.kind
        for lost in range(MAX_ATTEMPTS):
            try:
                slot, life = await self._take.receive()
                while life != slot.life:
                    slot, life = await self._take.receive()
            except anyio.EndOfStream:
                raise PermanentFailure(f"no {kind} was there for {self._terms.patience_s:g} s") from None
            try:
                played = await slot.worker.play(key, versions, self._terms.timeout_s)
            except WorkerLost:
                self._lose(slot, life)
                continue
            if life == slot.life:
                self._give.send_nowait((slot, life))
            if isinstance(played, Exception):
                raise played
            return played.model_copy(update={"attempts": played.attempts + lost})
        return unplayed(key, f"{MAX_ATTEMPTS} {kind}s were lost while they played it", versions)

    def _lose(self, slot: WorkerSlot, life: int) -> None:
        """Mark a worker as lost. Each of its episodes reports the loss; only the first report has an effect."""
        if life == slot.life:
            slot.life += 1
            slot.ready = False
            self._tasks.start_soon(self._wait_for, slot)

    async def _wait_for(self, slot: WorkerSlot) -> None:
        """Prepare a worker, retrying until it is ready or the patience runs out; then offer it to waiting episodes.

        Raises:
            UsageError: The worker has a problem that only the operator can solve.
        """
        with anyio.move_on_after(self._terms.patience_s):
            while not slot.ready:
                try:
                    problem = await slot.worker.prepare()
                except WorkerLost:
                    await anyio.sleep(_AGAIN_S)
                    continue
                if problem is not None:
                    raise problem
                slot.ready = True
            for _ in range(slot.places):
                self._give.send_nowait((slot, slot.life))
            self._decided.set()
            return
        self._slots.remove(slot)
        if not self._slots:
            self._give.close()
            self._decided.set()

    async def _close(self, slot: WorkerSlot) -> None:
        with contextlib.suppress(WorkerLost):
            await slot.worker.close()


def shares(concurrency: int, count: int) -> list[int]:
    """Split the number of concurrent episodes evenly among workers."""
    return [concurrency // count + (number < concurrency % count) for number in range(count)]


def lanes_of(config: RunConfig, participants: Mapping[str, Participant]) -> dict[str, int]:
    """Largest number of concurrent requests to each provider that the run uses."""
    lanes = dict(config.lanes)
    for participant in participants.values():
        match participant.facts():
            case {"provider": str(provider), "concurrency": int(limit)}:
                lanes[provider] = limit
            case _:
                pass
    return lanes
