"""`--executor ray`: workers on a Ray cluster play the episodes, for operators who need more than one machine.

Knows Ray and no run folders. Ray itself is loaded when workers are started, and not before.
"""

import contextlib
import importlib
import logging
import os
import socket
from collections.abc import AsyncGenerator, Generator, Mapping
from dataclasses import dataclass, replace
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from evaluator.episode.loop import Participant
from evaluator.errors import PermanentFailure, UsageError
from evaluator.records.episode import Episode, EpisodeKey, Versions
from evaluator.records.run import RunRecord
from evaluator.study.run_config import RunConfig
from evaluator.study.runner import Play
from evaluator.study.workers import EpisodeWorker, Terms, WorkerLost, Workers, WorkerSlot, lanes_of, shares

EXTRA = "physment-mcp[ray]"
ADDRESS_VARIABLE = "RAY_ADDRESS"
"""Environment variable with the address of a cluster. Without it, Ray is started on this machine for the run."""
_KIND = "Ray worker"
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


@dataclass(frozen=True, slots=True)
class _RayWorker:
    """An actor, which stays the same when Ray starts it again on another node."""

    ray: Any
    actor: Any

    async def prepare(self) -> UsageError | None:
        """As in `Worker`."""
        with self._lost():
            return await self.actor.prepare.remote()

    async def play(
        self, key: EpisodeKey, versions: Versions, timeout_s: float | None
    ) -> Episode | PermanentFailure | UsageError:
        """As in `Worker`."""
        with self._lost():
            return await self.actor.play.remote(key, versions, timeout_s)

    async def close(self) -> None:
        """As in `Worker`."""
        with self._lost():
            await self.actor.close.remote()

    @contextlib.contextmanager
    def _lost(self) -> Generator[None]:
        try:
            yield
        except self.ray.exceptions.RayTaskError:
            # An error in our own code on the worker: playing again would only repeat it.
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
    """Workers on the cluster at `RAY_ADDRESS` or on this machine, one for each processor.

    Args:
        config: The configuration of the run; every node must be able to build its agents.
        participants: The same, built here; their facts hold the limits of the providers, which the workers share.
        record: The record of the run.
        patience_s: How long a lost worker is waited for [s].

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
            # Two calls more than episodes: `prepare` and `close`. Ray must not repeat calls: attempts are counted here.
            actor = ray.remote(EpisodeWorker).options(
                num_cpus=1,
                max_concurrency=places + 2,
                max_restarts=-1,
                max_task_retries=0,
                scheduling_strategy="SPREAD",
            )
            actors.append(actor.remote(shared, Path.cwd(), metadata.version("physment-mcp"), packs, _KIND))
            slots.append(WorkerSlot(_RayWorker(ray, actors[-1]), places))
        async with Workers(slots, Terms(record, config.episode_timeout_s, patience_s, _KIND)).at_work() as play:
            yield play
    finally:
        for actor in actors:
            ray.kill(actor, no_restart=True)
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
