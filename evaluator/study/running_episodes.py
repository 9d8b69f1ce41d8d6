"""Lists the running episodes for `watch` in a small file in the run folder, which is removed at the end."""

import contextlib
import time
from collections.abc import Generator
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta

import anyio

from evaluator.episode.underway import UNDERWAY, Underway
from evaluator.records.episode import EpisodeKey
from evaluator.records.run import RunningEpisode, RunningEpisodes
from evaluator.store.run_folder import RunFolder

_EVERY_S = 1.0
"""Time between two writes of the file [s]."""


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
        """Rewrite the file at intervals until cancelled; then remove it."""
        try:
            while True:
                self.write()
                await anyio.sleep(_EVERY_S)
        finally:
            self.folder.running_file.unlink(missing_ok=True)

    def write(self) -> None:
        """Write the file. Errors are ignored, because the file is only for display."""
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
