"""The run folder: records on disk that survive a kill at any moment. Does not interpret the records.

`run.json` holds the settings that decide the result. `episodes.jsonl` and `grades.jsonl` hold one line per record,
`frames` one file per distinct image. If a kill leaves an unfinished last line, it is moved to `*.torn`, and its episode
is played again.
"""

import hashlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from pydantic import ValidationError

from evaluator.errors import StoreError, reason_of
from evaluator.records.episode import Episode, EpisodeKey, Frame, GradeRecord, Record
from evaluator.records.evidence import EvidenceRecord
from evaluator.records.run import RunRecord
from evaluator.store import durable
from evaluator.store.redaction import Redaction

R = TypeVar("R", bound=Record)


@dataclass(frozen=True, slots=True)
class RunFolder:
    """The files of one run."""

    path: Path
    redaction: Redaction = field(default_factory=Redaction, repr=False, compare=False)
    """Redacts secrets in episodes before they are written."""
    on_line: Callable[[bytes], object] = field(default=len, repr=False, compare=False)
    """Called with the line of each episode after it has been written, without its line feed."""

    @property
    def run_file(self) -> Path:
        """Path of `run.json`."""
        return self.path / "run.json"

    @property
    def episodes_file(self) -> Path:
        """Path of `episodes.jsonl`, with one line per episode played."""
        return self.path / "episodes.jsonl"

    @property
    def grades_file(self) -> Path:
        """Path of `grades.jsonl`, with one line per grade."""
        return self.path / "grades.jsonl"

    @property
    def evidence_file(self) -> Path:
        """Path of `evidence.jsonl`, with one line per episode whose evidence was measured."""
        return self.path / "evidence.jsonl"

    @property
    def running_file(self) -> Path:
        """Path of the file that lists the episodes being played. The file exists only during the run."""
        return self.path / "running.json"

    @property
    def seal_file(self) -> Path:
        """Path of the seal of the episodes."""
        return self.path / "seal.json"

    @property
    def summary_file(self) -> Path:
        """Path of the summary of the run."""
        return self.path / "summary.json"

    @property
    def report_file(self) -> Path:
        """Path of the report."""
        return self.path / "report.html"

    def create(self, *, resume: bool) -> None:
        """Create the folder, or check that it can be used.

        Args:
            resume: Whether the folder may hold a run already.

        Raises:
            StoreError: The folder cannot be written, or holds a run and `resume` is false.
        """
        if self.run_file.exists() and not resume:
            raise StoreError(f"{self.path} holds a run already; add --resume to continue it, or choose another --out")
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            probe = self.path / ".writable"
            probe.write_text("", encoding="utf-8")
            probe.unlink()
        except OSError as error:
            raise StoreError(f"the folder {self.path} cannot be written: {error.strerror}") from error

    def held(self) -> AbstractContextManager[None]:
        """Lock the folder while its run is played. The operating system releases the lock when the process ends.

        Raises:
            StoreError: Another process has locked it.
        """
        return durable.locked(self.path)

    def write_run(self, record: RunRecord) -> None:
        """Write `run.json`."""
        durable.replace(self.run_file, record.model_dump_json(indent=2) + "\n")

    def read_run(self) -> RunRecord:
        """Read `run.json`.

        Raises:
            StoreError: The file is missing or is not the record of a run.
        """
        try:
            return RunRecord.model_validate_json(self.run_file.read_bytes())
        except (OSError, ValidationError) as error:
            raise StoreError(
                f"{self.path} is not a run folder: run.json cannot be read ({reason_of(error)})"
            ) from error

    @property
    def frames_folder(self) -> Path:
        """Path of the folder of images that agents saw, with one file per distinct image."""
        return self.path / "frames"

    def append_episode(self, episode: Episode) -> None:
        """Append an episode and its frames, synchronised to disk."""
        for frame in _frames(episode):
            if frame.png:
                self._keep_frame(frame)
        line = self.redaction.record(episode).model_dump_json().encode("utf-8")
        durable.append_line(self.episodes_file, line)
        self.on_line(line)

    def copy_frames(self, source: "RunFolder", episode: Episode) -> None:
        """Copy the frames of an episode from another run folder.

        Raises:
            StoreError: A frame is missing in `source` or cannot be written.
        """
        for frame in _frames(episode):
            file = source.frames_folder / f"{frame.name}.png"
            try:
                self._keep_frame(Frame(name=frame.name, png=file.read_bytes()))
            except OSError as error:
                raise StoreError(f"{file} cannot be read: {error.strerror}") from error

    def episodes(self) -> dict[EpisodeKey, Episode]:
        """Return all episodes by key. If several records have the same key, the last one counts.

        Raises:
            StoreError: A line in the middle is damaged.
        """
        return {episode.key: episode for episode in self._read(self.episodes_file, Episode)}

    def episode_lines(self) -> list[bytes]:
        """The complete lines of `episodes.jsonl`, unparsed.

        Raises:
            StoreError: The file cannot be read.
        """
        return _lines(self.episodes_file)[:-1]

    def line_hashes(self) -> dict[EpisodeKey, str]:
        """Map the key of each episode to the SHA-256 of its record; the last of several lines with a key counts."""
        lines = self.episode_lines()
        return {Episode.model_validate_json(line).key: hashlib.sha256(line).hexdigest() for line in lines}

    def keep_episodes(self, is_kept: Callable[[EpisodeKey], bool]) -> int:
        """Delete the records of all episodes for which `is_kept` is false; return how many lines were deleted.

        Raises:
            StoreError: A record is damaged, or the file cannot be written.
        """
        stored = self._read(self.episodes_file, Episode)
        kept = [line for line, episode in zip(self.episode_lines(), stored, strict=True) if is_kept(episode.key)]
        if self.episodes_file.exists():
            durable.replace(self.episodes_file, b"".join(line + b"\n" for line in kept))
        return len(stored) - len(kept)

    def read_seal(self) -> durable.Seal | None:
        """The seal of the episodes; None if there is none.

        Raises:
            StoreError: The seal cannot be read.
        """
        if not self.seal_file.exists():
            return None
        try:
            return durable.Seal.model_validate_json(self.seal_file.read_bytes())
        except (OSError, ValidationError) as error:
            raise StoreError(f"{self.seal_file} is no seal of a run: {reason_of(error)}") from error

    def write_seal(self, seal: durable.Seal) -> None:
        """Write the seal of the episodes."""
        durable.replace(self.seal_file, seal.model_dump_json(indent=2) + "\n")

    def set_damage_aside(self) -> list[str]:
        """Move every line of `episodes.jsonl` that cannot be parsed to `episodes.jsonl.torn`.

        The episodes of these lines are then missing. An unfinished last line counts as damaged only if it was sealed.
        Otherwise a kill left it, and the next call of `append_episode` moves it.

        Returns:
            A sentence for each damaged line.

        Raises:
            StoreError: A file cannot be read or written.
        """
        file = self.episodes_file
        lines = _lines(file)
        problems = {place: _damage(line) for place, line in enumerate(lines[:-1])}
        seal = self.read_seal()
        if lines[-1] and seal and len(lines) <= seal.lines:
            problems[len(lines) - 1] = "its end is missing"
            lines.append(b"")
        damaged = [place for place, problem in problems.items() if problem]
        if damaged:
            durable.keep_aside(file, [lines[place] for place in damaged])
            kept = [line for place, line in enumerate(lines) if place not in damaged]
            durable.replace(file, b"\n".join(kept))
        return [
            f"{file}, line {place + 1} was damaged ({problems[place]}); it is in {file.name}.torn, and its episode is"
            " played again"
            for place in damaged
        ]

    def write_grades(self, grades: Iterable[GradeRecord]) -> None:
        """Replace all grades."""
        durable.replace(self.grades_file, "".join(grade.model_dump_json() + "\n" for grade in grades))

    def grades(self) -> dict[EpisodeKey, GradeRecord]:
        """All grades by the key of their episodes.

        Raises:
            StoreError: A line in the middle is damaged.
        """
        return {grade.key: grade for grade in self._read(self.grades_file, GradeRecord)}

    def append_evidence(self, evidence: EvidenceRecord) -> None:
        """Append the evidence of an episode, synchronised to disk."""
        durable.append_line(self.evidence_file, evidence.model_dump_json().encode())

    def evidence(self) -> dict[EpisodeKey, EvidenceRecord]:
        """Return the evidence by the key of its episode, without episodes that have been played again since.

        If several records have the same key, the last one counts.

        Raises:
            StoreError: A line in the middle is damaged.
        """
        if not self.evidence_file.exists():
            return {}
        stored = {found.key: found for found in self._read(self.evidence_file, EvidenceRecord)}
        hashes = self.line_hashes()
        return {key: found for key, found in stored.items() if found.episode == hashes.get(key)}

    def keep_grades(self) -> Path:
        """Back up the grades to a new file that is never overwritten, and return its path."""
        number = 1
        while (kept := self.path / f"grades.{number}.jsonl").exists():
            number += 1
        durable.replace(kept, self.grades_file.read_text(encoding="utf-8"))
        return kept

    def write_text(self, file: Path, text: str) -> None:
        """Atomically write a file that is derived from the records."""
        durable.replace(file, text)

    def _keep_frame(self, frame: Frame) -> None:
        """Write a frame, unless a file with the same content exists."""
        file = self.frames_folder / f"{frame.name}.png"
        if file.exists():
            return
        try:
            self.frames_folder.mkdir(exist_ok=True)
        except OSError as error:
            raise StoreError(f"{self.frames_folder} cannot be written: {error.strerror}") from error
        durable.replace(file, frame.png)

    def _read(self, file: Path, kind: type[R]) -> list[R]:
        records: list[R] = []
        for number, line in enumerate(_lines(file)[:-1], start=1):
            try:
                records.append(kind.model_validate_json(line))
            except ValidationError as error:
                raise StoreError(
                    f"{file}, line {number} is damaged: {reason_of(error)}; `physment-eval run --resume` with the"
                    " options of the run sets it aside"
                ) from error
        return records


def _lines(file: Path) -> list[bytes]:
    """The complete lines of a file, followed by the unfinished rest; a missing file counts as empty."""
    try:
        # Split at line feeds only: `str.splitlines` also splits at U+2028 and other characters that agents write.
        return file.read_bytes().split(b"\n")
    except FileNotFoundError:
        return [b""]
    except OSError as error:
        raise StoreError(f"{file} cannot be read: {error.strerror}") from error


def _frames(episode: Episode) -> Iterator[Frame]:
    for turn in episode.turns:
        for exchange in turn.exchanges:
            yield from exchange.frames


def _damage(line: bytes) -> str:
    """The reason why a line is not a valid episode record; empty if it is valid."""
    try:
        Episode.model_validate_json(line)
    except ValidationError as error:
        return reason_of(error)
    return ""
