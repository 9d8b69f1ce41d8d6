"""`--executor ray`: workers on a Ray cluster play the episodes, for operators who need more than one machine.

Knows Ray and no run folders. The process that the operator started hands episodes out, takes their records back and
writes them. Ray itself is loaded when workers are started, and not before.
"""

import contextlib
import importlib
import logging
import math
import os
import platform
import socket
from collections.abc import AsyncGenerator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import anyio

from evaluator.episode.connect import Laboratory, connect
from evaluator.episode.contender import Contender
from evaluator.errors import PermanentFailure, UsageError
from evaluator.records import Episode, EpisodeKey, Versions
from evaluator.run_record import RunRecord
from evaluator.study.attempts import MAX_ATTEMPTS, Play, play_key, unplayed
from evaluator.study.contenders import Team
from scenes import find_pack, same_pack

EXTRA = "physment-mcp[ray]"
ADDRESS_VARIABLE = "RAY_ADDRESS"
"""Environment variable with the address of a cluster. Without it, Ray is started on this machine for the run."""
_AGAIN_S = 0.5
"""Pause before a worker that did not reply is asked again whether it is ready [s]."""
_CLOSE_S = 5.0
"""Longest time for workers to end the servers they started [s]."""
_CONNECT_S = 5.0
"""Longest time for a cluster to accept a connection [s]."""
PATIENCE_S = 600.0
"""How long a lost worker is waited for [s]. Ray starts it again as soon as a node has room."""


def require_ray() -> None:
    """Check that Ray is installed, without loading it.

    Raises:
        UsageError: It is not.
    """
    if find_spec("ray") is None:
        raise UsageError(f"--executor ray needs Ray, which is not installed: pip install '{EXTRA}'")


@dataclass(slots=True)
class EpisodeWorker:
    """What runs on a node: plays the episodes it is given, several at a time, in a laboratory of its own."""

    team: Team
    folder: Path
    """Where the run was started: relative paths in options start here, on machines that share the folder."""
    version: str
    """Version of this package where the run was started."""
    packs: Mapping[str, str]
    """Scene → hash of the pack that the run is recorded with; empty if a host of others has the packs."""
    _contenders: Mapping[str, Contender] = field(default_factory=dict[str, Contender])
    _laboratory: Laboratory | None = None
    _open: contextlib.AsyncExitStack = field(default_factory=contextlib.AsyncExitStack)

    async def prepare(self) -> UsageError | None:
        """Get ready to play. A problem is returned and not raised, since Ray wraps raised errors."""
        if self._laboratory is not None:
            return None
        try:
            with contextlib.suppress(OSError):
                os.chdir(self.folder)
            if (here := metadata.version("physment-mcp")) != self.version:
                return UsageError(f"a Ray worker on {platform.node()} has version {here}, not {self.version}")
            for scene, known in self.packs.items():
                if not same_pack(known, find_pack(int(scene), self.team.scenes_dir)):
                    return UsageError(f"a Ray worker on {platform.node()} has another pack of scene {scene}")
            self._contenders = self.team.build()
            for contender in self._contenders.values():
                await self._open.enter_async_context(contender.running())
            place = connect(self.team.server, self.team.scenes_dir, self.team.observations, self.team.seed_of)
            self._laboratory = await self._open.enter_async_context(place)
        except Exception as error:  # noqa: BLE001 - whatever a node lacks, the operator must learn which node it is
            return UsageError(f"a Ray worker on {platform.node()} cannot play: {error}")
        return None

    async def play(
        self, key: EpisodeKey, versions: Versions, timeout_s: float | None
    ) -> Episode | PermanentFailure | UsageError:
        """Play one episode. Errors that end more than this episode are returned."""
        assert self._laboratory is not None
        try:
            return await play_key(self._contenders[key.agent], self._laboratory, key, versions, timeout_s)
        except (PermanentFailure, UsageError) as error:
            return error

    async def close(self) -> None:
        """End the servers that were started and close connections."""
        await self._open.aclose()


@dataclass(slots=True, eq=False)
class _Seat:
    """A worker as the run sees it. Its actor stays the same when Ray starts it again on another node."""

    actor: Any
    places: int
    """Episodes it plays at a time."""
    ready: bool = False
    life: int = 0
    """How often it was lost. A place that was given out in an earlier life is void."""


@dataclass(frozen=True, slots=True)
class _Terms:
    """What is the same for every episode of a run."""

    record: RunRecord
    timeout_s: float | None
    """Wall time of one attempt [s]."""
    patience_s: float
    """How long a lost worker is waited for [s]."""


class RayWorkers:
    """Hands episodes out to workers. An episode whose worker was lost is played again."""

    def __init__(self, ray: Any, seats: Sequence[_Seat], terms: _Terms) -> None:
        self._ray = ray
        self._seats = list(seats)
        self._terms = terms
        self._tasks = anyio.create_task_group()
        self._decided = anyio.Event()
        """Set when a worker is ready, or when all have been given up."""
        self._give, self._take = anyio.create_memory_object_stream[tuple[_Seat, int]](math.inf)

    @contextlib.asynccontextmanager
    async def at_work(self) -> AsyncGenerator[Play]:
        """Prepare the workers, wait for the first one, and close all of them at the end.

        Raises:
            UsageError: A worker has a problem that only the operator can solve.
        """
        with self._give, self._take:
            async with self._tasks:
                for seat in self._seats:
                    self._tasks.start_soon(self._wait_for, seat)
                await self._decided.wait()
                try:
                    yield self._play
                finally:
                    self._tasks.cancel_scope.cancel()
                    with anyio.move_on_after(_CLOSE_S, shield=True):
                        async with anyio.create_task_group() as closing:
                            for seat in self._seats:
                                if seat.ready:
                                    closing.start_soon(self._close, seat)

    async def _play(self, key: EpisodeKey) -> Episode:
        versions = self._terms.record.versions_of(key.scene)
        for lost in range(MAX_ATTEMPTS):
            try:
                seat, life = await self._take.receive()
                while life != seat.life:
                    seat, life = await self._take.receive()
            except anyio.EndOfStream:
                raise PermanentFailure(f"no Ray worker was there for {self._terms.patience_s:g} s") from None
            try:
                played = await seat.actor.play.remote(key, versions, self._terms.timeout_s)
            except self._ray.exceptions.RayTaskError:
                # An error in our own code on the worker: playing again would only repeat it.
                raise
            except self._ray.exceptions.RayError:
                self._lose(seat, life)
                continue
            if life == seat.life:
                self._give.send_nowait((seat, life))
            if isinstance(played, Exception):
                raise played
            return played.model_copy(update={"attempts": played.attempts + lost})
        return unplayed(key, f"{MAX_ATTEMPTS} Ray workers were lost while they played it", versions)

    def _lose(self, seat: _Seat, life: int) -> None:
        """Count a worker as lost. Each of its episodes reports the loss; the first report counts."""
        if life == seat.life:
            seat.life += 1
            seat.ready = False
            self._tasks.start_soon(self._wait_for, seat)

    async def _wait_for(self, seat: _Seat) -> None:
        """Ask a worker until it is ready, then give out its places.

        Raises:
            UsageError: The worker has a problem that only the operator can solve.
        """
        with anyio.move_on_after(self._terms.patience_s):
            while not seat.ready:
                try:
                    problem = await seat.actor.prepare.remote()
                except self._ray.exceptions.RayActorError:
                    await anyio.sleep(_AGAIN_S)
                    continue
                if problem is not None:
                    raise problem
                seat.ready = True
            for _ in range(seat.places):
                self._give.send_nowait((seat, seat.life))
            self._decided.set()
            return
        self._seats.remove(seat)
        if not self._seats:
            self._give.close()
            self._decided.set()

    async def _close(self, seat: _Seat) -> None:
        with contextlib.suppress(self._ray.exceptions.RayError):
            await seat.actor.close.remote()


@contextlib.asynccontextmanager
async def ray_workers(
    team: Team,
    contenders: Mapping[str, Contender],
    record: RunRecord,
    *,
    concurrency: int,
    timeout_s: float | None = None,
    patience_s: float = PATIENCE_S,
) -> AsyncGenerator[Play]:
    """Workers on the cluster at `RAY_ADDRESS` or on this machine, one for each processor.

    Args:
        team: Who plays; every node must be able to build it.
        contenders: The same, built here; their facts hold the limits of the providers, which the workers share.
        record: The record of the run.
        concurrency: Episodes at a time, over all workers.
        timeout_s: Wall time of one attempt at an episode [s]; None for no limit.
        patience_s: How long a lost worker is waited for [s].

    Raises:
        UsageError: Ray is not installed, no cluster is at that address, or a worker lacks something.
    """
    ray = _connected()
    seats: list[_Seat] = []
    try:
        lanes = _lanes(team, contenders)
        count = max(1, min(int(ray.cluster_resources().get("CPU", 1)), concurrency, *lanes.values()))
        shared = replace(team, lanes={provider: max(1, limit // count) for provider, limit in lanes.items()})
        packs = record.packs if team.server in {"stdio", "host"} else {}
        for number in range(count):
            places = concurrency // count + (number < concurrency % count)
            # Two calls more than episodes: `prepare` and `close`. Ray must not repeat calls: attempts are counted here.
            actor = ray.remote(EpisodeWorker).options(
                num_cpus=1,
                max_concurrency=places + 2,
                max_restarts=-1,
                max_task_retries=0,
                scheduling_strategy="SPREAD",
            )
            seats.append(_Seat(actor.remote(shared, Path.cwd(), metadata.version("physment-mcp"), packs), places))
        async with RayWorkers(ray, seats, _Terms(record, timeout_s, patience_s)).at_work() as play:
            yield play
    finally:
        for seat in seats:
            ray.kill(seat.actor, no_restart=True)
        ray.shutdown()


def _connected() -> Any:
    require_ray()
    # Ray reports its use to its makers by default; a laboratory may not want that.
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    ray: Any = importlib.import_module("ray")
    address = os.environ.get(ADDRESS_VARIABLE)
    where = {"address": address} if address else {"address": "local", "include_dashboard": False}
    try:
        if address:
            _try_to_connect(address)
        ray.init(**where, log_to_driver=False, logging_level=logging.ERROR)
    except (OSError, ValueError, RuntimeError) as error:
        raise UsageError(f"--executor ray: no cluster at {ADDRESS_VARIABLE}={address}: {error}") from error
    return ray


def _try_to_connect(address: str) -> None:
    """Check that a program listens at the address: Ray itself would try for minutes.

    Raises:
        OSError: Nothing listens there.
        ValueError: It is not an address for programs that run on the cluster.
    """
    if "://" in address:
        raise ValueError("write host:port, and start the run on a machine of the cluster")
    host, colon, port = address.rpartition(":")
    if colon:
        socket.create_connection((host.strip("[]"), int(port)), _CONNECT_S).close()


def _lanes(team: Team, contenders: Mapping[str, Contender]) -> dict[str, int]:
    """Provider → most requests at a time, for every provider that is asked."""
    lanes = dict(team.lanes)
    for contender in contenders.values():
        match contender.facts():
            case {"provider": str(provider), "concurrency": int(limit)}:
                lanes[provider] = limit
            case _:
                pass
    return lanes
