"""Plays episodes a few at a time, here or elsewhere; each is on disk before the next counts."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import anyio

from evaluator.episode.connect import Laboratory
from evaluator.episode.contender import Contender
from evaluator.errors import PermanentFailure
from evaluator.records import Episode, EpisodeKey, Outcome, Versions
from evaluator.store import RunFolder
from evaluator.study.attempts import Play, play_key
from evaluator.study.limits import Meter


@dataclass(frozen=True, slots=True)
class Runner:
    """Plays episodes that a folder does not hold yet."""

    laboratory: Laboratory
    contenders: Mapping[str, Contender]
    """By name, as the keys have it."""
    folder: RunFolder
    versions: Callable[[int], Versions]
    """Scene → versions to record."""
    concurrency: int = 1
    meter: Meter = field(default_factory=Meter)
    timeout_s: float | None = None
    """Wall time of one attempt at an episode [s]."""
    on_start: Callable[[EpisodeKey], None] = field(default=lambda _key: None)
    on_end: Callable[[Episode], None] = field(default=lambda _episode: None)
    play: Play = play_key
    """Plays one episode; in this process if nothing else is said."""

    async def run(self, keys: Sequence[EpisodeKey]) -> str:
        """Play `keys`, at most `concurrency` at a time; each is on disk when `on_end` is told.

        Returns:
            Why episodes were left out: the limit that was reached, the agents that cannot be asked; empty if none were.

        Raises:
            StoreError: A record could not be written; what was written before stays.
        """
        waiting, given_up = list(reversed(keys)), dict[str, str]()

        async def worker() -> None:
            while waiting and not self.meter.reached():
                key = waiting.pop()
                if key.agent in given_up:
                    continue
                self.on_start(key)
                try:
                    episode = await self.play(
                        self.contenders[key.agent], self.laboratory, key, self.versions(key.scene), self.timeout_s
                    )
                except PermanentFailure as failure:
                    given_up[key.agent] = str(failure)
                    continue
                self.folder.append_episode(episode)
                self.meter.add(episode.usage)
                self.on_end(episode)

        async with anyio.create_task_group() as tasks:
            for _ in range(min(self.concurrency, len(keys))):
                tasks.start_soon(worker)
        return "; ".join([*dict.fromkeys(given_up.values()), *([self.meter.reached()] if waiting else [])])


def missing(keys: Iterable[EpisodeKey], done: Mapping[EpisodeKey, Episode]) -> list[EpisodeKey]:
    """Episodes still to be played: those without a record, and those that ended in an infrastructure error."""
    return [key for key in keys if key not in done or done[key].outcome is Outcome.INFRASTRUCTURE_ERROR]
