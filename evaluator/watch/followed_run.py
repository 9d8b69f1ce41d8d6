"""Follows the records of a run while they are written. Reads each line once, and never locks or writes a file.

The writer appends whole lines, and replaces the file only to remove damaged lines. A last line without a line feed is
still being written, and is read later.
"""

import contextlib
import hashlib
import json
from pathlib import Path
from typing import NamedTuple

from pydantic import ValidationError

from evaluator.answers.grading import grade_episode
from evaluator.answers.keys import KeyRing
from evaluator.errors import StoreError, UsageError
from evaluator.records.episode import Episode, EpisodeKey, Outcome, Usage, Verdict
from evaluator.records.run import RunningEpisode, RunningEpisodes, RunRecord
from evaluator.scores.dimensions import ExperimentCost, cost_of
from evaluator.scores.grouping import rung
from evaluator.scores.scored_episode import scene_title
from evaluator.store.run_folder import RunFolder
from scenes import LabLimits, PackError, Rung, find_pack, read_public, reference_of, same_pack

_SHOWN = 200
"""Largest number of characters kept of an answer or an error message."""


class FollowedEpisode(NamedTuple):
    """Summary of an episode that has ended."""

    key: EpisodeKey
    outcome: Outcome
    verdict: Verdict | None
    """None if the episode cannot be graded on this machine."""
    answer: str
    """The answer as JSON, truncated."""
    error: str
    """Error message of an episode that ended early; otherwise empty."""
    turns: int
    cost: ExperimentCost
    usage: Usage | None
    started_at: str
    duration_s: float
    is_open: bool
    """Whether its scene is an open world."""


class FollowedRun:
    """The records of a run folder that have been read so far."""

    def __init__(self, folder: RunFolder, keys: KeyRing, *, withheld: bool = False) -> None:
        """Read the run record.

        Args:
            folder: The run.
            keys: Answer keys of its scenes.
            withheld: Whether to grade nothing, because the seeds of the run are held back.

        Raises:
            StoreError: The folder is not a run folder.
        """
        self.folder = folder
        self.record: RunRecord = folder.read_run()
        self.episodes: dict[EpisodeKey, FollowedEpisode] = {}
        """Ended episodes, in the order of their records. If an episode has several records, the last one counts."""
        self.behind = False
        """Whether the folder contains further lines to read."""
        self.damaged = 0
        """Number of complete lines that cannot be parsed."""
        self.ungraded: dict[int, str] = {}
        """Scene → why its episodes cannot be graded."""
        self.withheld = withheld
        """Whether there are no verdicts, because the seeds are held back."""
        self.running: tuple[RunningEpisode, ...] = ()
        """Running episodes, as last listed by the run; empty if it lists none."""
        self.running_at = 0.0
        """Time at which the run wrote this list [s since 1970]."""
        self.keys = keys
        self._played_here: dict[tuple[int, str], bool] = {}
        """Scene and pack hash → whether the local pack is the same."""
        self._titles: dict[int, str] = {}
        self._known: dict[bytes, FollowedEpisode | None] = {}
        self._file: tuple[int, int] = (0, 0)
        """Inode of the file, and the position up to which it was read."""

    def look(self, most: int = 100) -> None:
        """Read new records.

        Args:
            most: Largest number of lines to read; `behind` says whether there are more.

        Raises:
            StoreError: The folder is gone or cannot be read.
        """
        self.record = self.folder.read_run()
        self.running = self._read_running()
        file = self.folder.episodes_file
        if not file.exists():
            return
        try:
            self._read_new(file, most)
        except OSError as error:
            raise StoreError(f"{file} cannot be read: {error.strerror}") from error

    def _read_running(self) -> tuple[RunningEpisode, ...]:
        """Read the list of running episodes; empty if the file is missing or is being written."""
        try:
            self.running_at = self.folder.running_file.stat().st_mtime
            return RunningEpisodes.model_validate_json(self.folder.running_file.read_bytes()).episodes
        except (OSError, ValidationError):
            return ()

    def _read_new(self, file: Path, most: int) -> None:
        self.behind = False
        with file.open("rb") as stream:
            found = file.stat()
            number, position = self._file
            if found.st_ino != number or found.st_size < position:
                # The writer has replaced the file to remove damaged lines. Known lines are not graded again.
                position, self.damaged = 0, 0
                self.episodes.clear()
            stream.seek(position)
            for place, line in enumerate(stream):
                self.behind = place == most
                if self.behind or not line.endswith(b"\n"):
                    break
                position += len(line)
                self._add(line)
            self._file = (found.st_ino, position)

    def _add(self, line: bytes) -> None:
        digest = hashlib.sha256(line).digest()
        if digest not in self._known:
            try:
                self._known[digest] = self._watched(Episode.model_validate_json(line))
            except ValidationError:
                self._known[digest] = None
        known = self._known[digest]
        if known is None:
            self.damaged += 1
        else:
            self.episodes.pop(known.key, None)
            self.episodes[known.key] = known

    def _watched(self, episode: Episode) -> FollowedEpisode:
        key, verdict, limits, is_open = episode.key, None, LabLimits(), False
        try:
            facts = self.keys.facts(key.scene)
            limits, is_open = facts.limits, rung(facts.category) == Rung.OPEN
            verdict = self._verdict(episode)
        except UsageError as error:
            self.ungraded[key.scene] = str(error)
        return FollowedEpisode(
            key=key,
            outcome=episode.outcome,
            verdict=verdict,
            answer="" if episode.answer is None else json.dumps(episode.answer, ensure_ascii=False)[:_SHOWN],
            error=(episode.error or "")[:_SHOWN],
            turns=len(episode.turns),
            cost=cost_of(episode, limits),
            usage=episode.usage,
            started_at=episode.started_at,
            duration_s=episode.duration_s,
            is_open=is_open,
        )

    def title(self, scene: int) -> str:
        """Return reference and name of a scene; the reference alone for a world, and if its pack is missing here."""
        if scene not in self._titles:
            name = ""
            with contextlib.suppress(PackError):
                name = read_public(find_pack(scene, self.keys.folder)).name
            self._titles[scene] = scene_title(scene, name)
        return self._titles[scene]

    def _verdict(self, episode: Episode) -> Verdict | None:
        """Grade an episode; None if the seeds are held back.

        Raises:
            UsageError: The pack is missing or malformed, or differs from the pack that was played.
        """
        key, pack = episode.key, episode.versions.pack
        if self.withheld:
            return None
        if (key.scene, pack) not in self._played_here:
            try:
                self._played_here[key.scene, pack] = same_pack(pack, find_pack(key.scene, self.keys.folder))
            except PackError as error:
                raise UsageError(str(error)) from error
        if not self._played_here[key.scene, pack]:
            raise UsageError(
                f"scene {reference_of(key.scene)} was played on another pack than the one here; name its folder"
                " with --scenes-dir"
            )
        return grade_episode(episode, self.keys.key(key.scene, key.seed)).strict
