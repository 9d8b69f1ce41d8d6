"""Plays episodes, a few at a time. Each is on disk before it counts."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import anyio

from evaluator.errors import PermanentFailure
from evaluator.records.episode import Episode, EpisodeKey, Outcome
from evaluator.store.run_folder import RunFolder
from evaluator.study.attempts import Play
from evaluator.study.limits import Meter


def missing(keys: Iterable[EpisodeKey], done: Mapping[EpisodeKey, Episode]) -> list[EpisodeKey]:
    """Episodes still to be played: those without a record, and those that ended in an infrastructure error."""
    return [key for key in keys if key not in done or done[key].outcome is Outcome.INFRASTRUCTURE_ERROR]


@dataclass(frozen=True, slots=True, kw_only=True)
class Runner:
    """Plays episodes into a run folder."""

    play: Play
    folder: RunFolder
    concurrency: int = 1
    """Most episodes at a time."""
    meter: Meter = field(default_factory=Meter)
    """Adds up what the episodes use, and knows the limits."""
    on_start: Callable[[EpisodeKey], None] = field(default=lambda _key: None)
    on_end: Callable[[Episode], None] = field(default=lambda _episode: None)
    """Called when an episode is on disk."""

    async def run(self, keys: Sequence[EpisodeKey]) -> str:
        """Play these episodes in their order.

        Returns:
            Why some were left out, as a clause: agents that cannot be asked, a limit; empty if none were.

        Raises:
            StoreError: A record could not be written; what was written before is kept.
        """
        waiting, given_up = list(reversed(keys)), dict[str, str]()

        async def worker() -> None:
            while waiting and not self.meter.reached():
                key = waiting.pop()
                if key.agent in given_up:
                    continue
                self.on_start(key)
                try:
                    episode = await self.play(key)
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
