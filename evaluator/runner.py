"""The matrix of a run: which episodes are missing, played a few at a time, each on disk before the next counts."""

import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

import anyio

from evaluator.agents.base import Agent
from evaluator.connect import Laboratory
from evaluator.episode import play_episode
from evaluator.errors import InfrastructureError
from evaluator.records import Episode, EpisodeKey, Outcome, Versions
from evaluator.store import RunFolder
from scenes import PackFiles

MAX_ATTEMPTS = 3
"""How often an episode is opened before its infrastructure error is recorded."""
_PAUSE_S = 0.5
"""Pause before the second attempt [s]; doubled for each further one."""


@dataclass(frozen=True, slots=True)
class Plan:
    """What a run consists of."""

    scenes: tuple[int, ...]
    agent: str
    budgets: tuple[int, ...] = (20,)
    seeds: tuple[int, ...] = (0,)
    epochs: int = 1
    prompting: str = "zero-shot"
    protocol: str = "native"

    def keys(self) -> list[EpisodeKey]:
        """All episodes of the run, in playing order."""
        return [
            EpisodeKey(
                scene=scene,
                seed=seed,
                agent=self.agent,
                budget=budget,
                prompting=self.prompting,
                protocol=self.protocol,
                epoch=epoch,
            )
            for epoch in range(1, self.epochs + 1)
            for budget in self.budgets
            for seed in self.seeds
            for scene in self.scenes
        ]


@dataclass(frozen=True, slots=True)
class Runner:
    """Plays the episodes of a plan that a folder does not hold yet."""

    laboratory: Laboratory
    agent: Agent
    folder: RunFolder
    versions: Callable[[int], Versions]
    """Scene → versions to record."""
    concurrency: int = 1
    on_start: Callable[[EpisodeKey], None] = field(default=lambda _key: None)
    on_end: Callable[[Episode], None] = field(default=lambda _episode: None)

    async def run(self, keys: Sequence[EpisodeKey]) -> None:
        """Play `keys`, at most `concurrency` at a time; each is on disk when `on_end` is told.

        Raises:
            StoreError: A record could not be written; what was written before stays.
        """
        waiting = iter(keys)

        async def worker() -> None:
            for key in waiting:
                self.on_start(key)
                episode = await self._play(key)
                self.folder.append_episode(episode)
                self.on_end(episode)

        async with anyio.create_task_group() as tasks:
            for _ in range(min(self.concurrency, len(keys))):
                tasks.start_soon(worker)

    async def _play(self, key: EpisodeKey) -> Episode:
        """Play an episode, anew if the infrastructure fails."""
        failure, versions = "", self.versions(key.scene)
        for attempt in range(1, MAX_ATTEMPTS + 1):
            if attempt > 1:
                await anyio.sleep(_PAUSE_S * 2 ** (attempt - 2))
            try:
                async with self.laboratory.open(key.scene, key.seed) as client:
                    episode = await play_episode(self.agent, client, key, versions)
                return episode.model_copy(update={"attempts": attempt})
            except InfrastructureError as error:
                failure = str(error)
        return _unplayed(key, failure, versions)


def missing(keys: Iterable[EpisodeKey], done: dict[EpisodeKey, Episode]) -> list[EpisodeKey]:
    """Episodes still to be played: those without a record, and those that only infrastructure errors ended."""
    return [key for key in keys if key not in done or done[key].outcome is Outcome.INFRASTRUCTURE_ERROR]


def pack_hash(files: PackFiles) -> str:
    """Short hash of a pack's files, so that a record says which pack it was played on."""
    digest = hashlib.sha256()
    for file in (files.json, files.mjcf, files.solution):
        digest.update(file.name.encode())
        digest.update(_content(file))
    return digest.hexdigest()[:12]


def _content(file: Path) -> bytes:
    return file.read_bytes() if file.is_file() else b""


def _unplayed(key: EpisodeKey, failure: str, versions: Versions) -> Episode:
    return Episode(
        key=key,
        outcome=Outcome.INFRASTRUCTURE_ERROR,
        prompt="",
        turns=(),
        error=failure,
        attempts=MAX_ATTEMPTS,
        started_at=datetime.now(UTC).isoformat(timespec="milliseconds"),
        duration_s=0.0,
        versions=versions,
    )
