"""`--executor ray`: workers on a Ray cluster play the episodes, for operators who need more than one machine.

This module does not access run folders. Ray is imported when the workers are started.
"""

import contextlib
import logging
import os
import socket
from collections.abc import AsyncGenerator, Generator, Mapping
from dataclasses import dataclass, replace
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from evaluator.episode.loop import Participant
from evaluator.errors import PermanentFailure, UsageError
from evaluator.records.episode import Episode, EpisodeKey, Versions
from evaluator.records.run import RunRecord
from evaluator.study.run_config import RunConfig
from evaluator.study.runner import Play
from evaluator.study.workers import VERSION, EpisodeWorker, Terms, WorkerLost, Workers, WorkerSlot, lanes_of, shares

EXTRA = "physment-mcp[ray]"
ADDRESS_VARIABLE = "RAY_ADDRESS"
"""Environment variable with the address of a cluster. Without it, Ray is started on this machine for the run."""
_KIND = "Ray worker"
_CONNECT_S = 5.0
"""Longest time for a cluster to accept a connection [s]."""
PATIENCE_S = 600.0
"""Longest time for a lost worker to restart [s]. Ray restarts it as soon as a node has free resources."""


def require_ray() -> None:
    """Check that Ray is installed, without importing it.

    Raises:
        UsageError: Ray is not installed.
    """
    if find_spec("ray") is None:
        raise UsageError(f"--executor ray needs Ray, which is not installed: pip install '{EXTRA}'")


@dataclass(frozen=True, slots=True)
class _RayWorker:
    """A `Worker` in a Ray actor. Its handle stays valid when Ray restarts the actor on another node."""

    ray: Any
    actor: Any

    async def prepare(self) -> UsageError | None:
        """Prepare the worker in the actor; see `Worker.prepare`."""
        with self._lost():
            return await self.actor.prepare.remote()

    async def play(
        self, key: EpisodeKey, versions: Versions, timeout_s: float | None
    ) -> Episode | PermanentFailure | UsageError:
        """Play one episode in the actor; see `Worker.play`."""
        with self._lost():
            return await self.actor.play.remote(key, versions, timeout_s)

    async def close(self) -> None:
        """Close the servers that the actor started; see `Worker.close`."""
        with self._lost():
            await self.actor.close.remote()

    @contextlib.contextmanager
    def _lost(self) -> Generator[None]:
        try:
            yield
        except self.ray.exceptions.RayTaskError:
            # A bug in this package, raised on the worker: a retry would fail in the same way.
            raise
        except self.ray.exceptions.RayError as error:
            raise WorkerLost from error


@contextlib.asynccontextmanager
async def ray_workers(
    config: RunConfig,
    participants: Mapping[str, Participant],
    record: RunRecord,
    *,
    patience_s: float = PATIENCE_S,
) -> AsyncGenerator[Play]:
    """Start one worker per processor of the cluster at `RAY_ADDRESS`, or of this machine if it is not set.

    Yields the function that plays an episode on one of them.

    Args:
        config: The configuration of the run; every node must be able to build its agents.
        participants: The participants of `config`. Their settings contain the concurrency limits of the providers,
            which are divided among the workers.
        record: The record of the run.
        patience_s: Longest time for a lost worker to restart [s].

    Raises:
        UsageError: Ray is not installed, no cluster is at that address, or a worker lacks something.
    """
    ray = _connected()
    slots: list[WorkerSlot] = []
    actors: list[Any] = []
    try:
        lanes = lanes_of(config, participants)
        count = max(1, min(int(ray.cluster_resources().get("CPU", 1)), config.concurrency, *lanes.values()))
        shared = replace(config, lanes={provider: max(1, limit // count) for provider, limit in lanes.items()})
        packs = record.packs if config.server in {"stdio", "host"} else {}
        for places in shares(config.concurrency, count):
            # `prepare` and `close` need two calls besides the episodes. Ray must not retry: attempts are counted here.
            actor = ray.remote(EpisodeWorker).options(
                num_cpus=1,
                max_concurrency=places + 2,
                max_restarts=-1,
                max_task_retries=0,
                scheduling_strategy="SPREAD",
            )
            actors.append(actor.remote(shared, Path.cwd(), VERSION, packs, _KIND))
            slots.append(WorkerSlot(_RayWorker(ray, actors[-1]), places))
        async with Workers(slots, Terms(record, config.episode_timeout_s, patience_s, _KIND)).at_work() as play:
            yield play
    finally:
        for actor in actors:
            ray.kill(actor, no_restart=True)
        ray.shutdown()


def _connected() -> Any:
    require_ray()
    # Ray sends usage statistics to its developers by default; this opts out.
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    ray: Any = import_module("ray")
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
    """Check that a program listens at the address, because Ray's own attempts take minutes to fail.

    Raises:
        OSError: Nothing listens there.
        ValueError: It is not an address for programs that run on the cluster.
    """
    if "://" in address:
        raise ValueError("write host:port, and start the run on a machine of the cluster")
    host, colon, port = address.rpartition(":")
    if colon:
        socket.create_connection((host.strip("[]"), int(port)), _CONNECT_S).close()
