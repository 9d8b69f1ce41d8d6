"""Plays episodes concurrently, retries them after infrastructure errors, and writes each to disk when it ends.

A meter adds up the cost, tokens and wall time of the episodes. Once a limit is reached, the run starts no further
episode. The running episodes are listed for `watch` in a small file in the run folder, which is removed at the end.
"""

import contextlib
import time
from collections.abc import Awaitable, Callable, Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta

import anyio

from evaluator.episode.connect import EpisodeConnector
from evaluator.episode.loop import Participant
from evaluator.episode.tracing import UNDERWAY, Underway, end_episode, episode_span
from evaluator.errors import InfrastructureError, PermanentFailure
from evaluator.records.episode import Episode, EpisodeKey, Outcome, Usage, Versions, timestamp, total_usage
from evaluator.records.run import RunningEpisode, RunningEpisodes
from evaluator.store.run_folder import RunFolder
from evaluator.study.meter import Meter

_EVERY_S = 1.0
"""Time between two writes of the file of running episodes [s]."""


@dataclass(slots=True)
class Board:
    """The running episodes of a run."""

    folder: RunFolder
    _present: dict[EpisodeKey, Underway] = field(default_factory=dict[EpisodeKey, Underway])

    @contextlib.contextmanager
    def shown(self, key: EpisodeKey) -> Generator[None]:
        """List an episode as running while the block plays it."""
        self._present[key] = underway = Underway(key)
        token = UNDERWAY.set(underway)
        try:
            yield
        finally:
            UNDERWAY.reset(token)
            del self._present[key]

    async def keep_written(self) -> None:
        """Rewrite the file of running episodes at intervals until cancelled; then remove it."""
        try:
            while True:
                self.write()
                await anyio.sleep(_EVERY_S)
        finally:
            self.folder.running_file.unlink(missing_ok=True)

    def write(self) -> None:
        """Write the file of running episodes. Errors are ignored, because the file is only for display."""
        clock, now = time.monotonic(), datetime.now(UTC)
        found = RunningEpisodes(
            episodes=tuple(
                RunningEpisode(
                    key=one.key,
                    turn=one.turn,
                    call=one.call,
                    began_at=(now - timedelta(seconds=clock - one.began_at)).isoformat(timespec="milliseconds"),
                )
                for one in self._present.values()
            )
        )
        with contextlib.suppress(OSError):
            self.folder.running_file.write_text(found.model_dump_json(), encoding="utf-8")


MAX_ATTEMPTS = 3
"""Number of attempts at an episode before an infrastructure error is recorded."""
_PAUSE_S = 0.5
"""Pause before the second attempt [s]; it doubles for each further attempt."""

Play = Callable[[EpisodeKey], Awaitable[Episode]]
"""Plays an episode and returns its record: in this process (`LocalPlay`), or in another one."""


@dataclass(frozen=True, slots=True)
class LocalPlay:
    """Plays episodes in this process."""

    laboratory: EpisodeConnector
    participants: Mapping[str, Participant]
    """Agent name in the episode keys → participant."""
    versions: Callable[[int], Versions]
    """Function of the scene id that returns the versions to record."""
    timeout_s: float | None = None
    """Time limit of one attempt, as wall time [s]; None for no limit."""

    async def __call__(self, key: EpisodeKey) -> Episode:
        """Play an episode; raises as `play_key` does."""
        participant, versions = self.participants[key.agent], self.versions(key.scene)
        return await play_key(participant, self.laboratory, key, versions, self.timeout_s)


async def play_key(
    participant: Participant,
    laboratory: EpisodeConnector,
    key: EpisodeKey,
    versions: Versions,
    timeout_s: float | None = None,
) -> Episode:
    """Play an episode until it has an outcome, or until all attempts have failed.

    Args:
        participant: The participant that plays the episode.
        laboratory: Connector to the laboratory.
        key: Key of the episode.
        versions: Versions to record with the episode.
        timeout_s: Time limit of one attempt, as wall time [s]; None for no limit. An attempt that exceeds it has
            failed.

    Raises:
        UsageError: The participant cannot play in this laboratory.
        PermanentFailure: This participant cannot play any episode.
    """
    with episode_span(key) as span:
        episode = await _attempted(participant, laboratory, key, versions, timeout_s)
        end_episode(span, episode)
        return episode


async def _attempted(
    participant: Participant, laboratory: EpisodeConnector, key: EpisodeKey, versions: Versions, timeout_s: float | None
) -> Episode:
    failure, used = "", list[Usage]()
    for attempt in range(1, MAX_ATTEMPTS + 1):
        if attempt > 1:
            await anyio.sleep(_PAUSE_S * 2 ** (attempt - 2))
        try:
            with anyio.move_on_after(timeout_s):
                episode = await participant.play(laboratory, key, versions, used)
                return episode.model_copy(update={"attempts": attempt})
            failure = f"the episode took longer than {timeout_s} s"
        except PermanentFailure:
            raise
        except InfrastructureError as error:
            failure = str(error)
    return unplayed(key, failure, versions, total_usage(used))


def unplayed(key: EpisodeKey, failure: str, versions: Versions, usage: Usage | None = None) -> Episode:
    """Return the record of an episode whose attempts all ended in an infrastructure error.

    Args:
        key: Key of the episode.
        failure: The last error, as a sentence.
        versions: Versions to record with the episode.
        usage: Usage of all attempts, if known.
    """
    return Episode(
        key=key,
        outcome=Outcome.INFRASTRUCTURE_ERROR,
        prompt="",
        turns=(),
        error=failure,
        attempts=MAX_ATTEMPTS,
        usage=usage,
        started_at=timestamp(),
        duration_s=0.0,
        versions=versions,
    )


def missing(keys: Iterable[EpisodeKey], done: Mapping[EpisodeKey, Episode]) -> list[EpisodeKey]:
    """Return the episodes still to be played: those without a record, and those with an infrastructure error."""
    return [key for key in keys if key not in done or done[key].outcome is Outcome.INFRASTRUCTURE_ERROR]


@dataclass(frozen=True, slots=True, kw_only=True)
class Runner:
    """Plays episodes into a run folder."""

    play: Play
    folder: RunFolder
    concurrency: int = 1
    """Largest number of episodes played at a time."""
    meter: Meter = field(default_factory=Meter)
    """Adds up the usage of the episodes and checks the limits."""
    on_start: Callable[[EpisodeKey], None] = field(default=lambda _key: None)
    on_end: Callable[[Episode], None] = field(default=lambda _episode: None)
    """Called after an episode has been written to disk."""

    async def run(self, keys: Sequence[EpisodeKey]) -> str:
        """Play episodes in the order given.

        Returns:
            Why some episodes were not played, as a clause: a failed provider or a reached limit. Empty if all were.

        Raises:
            StoreError: A record could not be written; what was written before is kept.
        """
        waiting, given_up = list(reversed(keys)), dict[str, str]()
        board = Board(self.folder)

        async def worker() -> None:
            while waiting and not self.meter.reached():
                key = waiting.pop()
                if key.agent in given_up:
                    continue
                self.on_start(key)
                try:
                    with board.shown(key):
                        episode = await self.play(key)
                except PermanentFailure as failure:
                    given_up[key.agent] = str(failure)
                    continue
                self.folder.append_episode(episode)
                self.meter.add(episode.usage)
                self.on_end(episode)

        async with anyio.create_task_group() as writing:
            writing.start_soon(board.keep_written)
            async with anyio.create_task_group() as tasks:
                for _ in range(min(self.concurrency, len(keys))):
                    tasks.start_soon(worker)
            writing.cancel_scope.cancel()
        return "; ".join([*dict.fromkeys(given_up.values()), *([self.meter.reached()] if waiting else [])])
