"""Durable files (atomic replacement, appended lines that are synchronised to disk) and the seal that protects a run.

The seal is a hash chain over the episodes. During a run, the evaluator keeps the chain in memory and never computes it
from the files. At the end it prints the head of the chain and writes it beside the records. Records that were changed
in between do not match the head. Anyone who can write the run folder can also replace the stored seal; only the printed
head reveals that.
"""

import contextlib
import hashlib
import os
from collections.abc import Generator, Iterable
from importlib.util import find_spec
from pathlib import Path
from typing import Literal

from pydantic import Field

from evaluator.errors import StoreError
from evaluator.records.episode import FORMAT, Record, is_absent


@contextlib.contextmanager
def locked(folder: Path) -> Generator[None]:
    """Lock a folder. The operating system unlocks it when the process ends in any way.

    Raises:
        StoreError: Another process has locked it.
    """
    if find_spec("fcntl") is None:
        yield  # Windows has no flock
        return
    import fcntl  # noqa: PLC0415

    handle = os.open(folder, os.O_RDONLY)
    try:
        # Some network file systems support no locks; a run continues without one.
        with contextlib.suppress(OSError):
            try:
                fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                sentence = f"{folder} is being played by another process; wait for its end, or choose another --out"
                raise StoreError(sentence) from None
        yield
    finally:
        os.close(handle)


def append_line(file: Path, line: bytes) -> None:
    """Append a line and synchronise it to disk. An unfinished last line is first moved to another file.

    Args:
        file: Path of the file.
        line: The line, without its line feed.

    Raises:
        StoreError: The file cannot be written.
    """
    try:
        # The writer repairs the file; readers must tolerate an unfinished last line.
        _keep_torn_line_aside(file)
        with file.open("ab") as stream:
            stream.write(line + b"\n")
            stream.flush()
            os.fsync(stream.fileno())
    except OSError as error:
        raise StoreError(f"{file} cannot be written: {error.strerror}") from error


def replace(file: Path, content: str | bytes) -> None:
    """Replace the content of a file atomically: a kill leaves either the old or the new content."""
    fresh = file.with_name(f".{file.name}.new")
    try:
        # Remove a temporary file that an earlier kill left. Also prevents writing through a planted symbolic link.
        fresh.unlink(missing_ok=True)
        with fresh.open("xb") as stream:
            stream.write(content.encode("utf-8") if isinstance(content, str) else content)
            stream.flush()
            os.fsync(stream.fileno())
        fresh.replace(file)
        _sync_folder(file.parent)
    except OSError as error:
        raise StoreError(f"{file} cannot be written: {error.strerror}") from error


def keep_aside(file: Path, lines: Iterable[bytes]) -> None:
    """Save lines that are about to be removed from a file in a second file beside it."""
    try:
        with file.with_name(file.name + ".torn").open("ab") as aside:
            aside.writelines(line + b"\n" for line in lines)
            aside.flush()
            os.fsync(aside.fileno())
    except OSError as error:
        raise StoreError(f"{file}.torn cannot be written: {error.strerror}") from error


def _keep_torn_line_aside(file: Path) -> None:
    """Move an unfinished last line to another file beside this one."""
    if not file.exists() or file.stat().st_size == 0:
        return
    with file.open("rb") as stream:
        stream.seek(-1, os.SEEK_END)
        if stream.read() == b"\n":
            return
    content = file.read_bytes()
    whole, _, torn = content.rpartition(b"\n")
    keep_aside(file, [torn])
    replace(file, whole + b"\n" if whole else b"")


def _sync_folder(folder: Path) -> None:
    """Synchronise a folder to disk. Until then, a power failure may undo a rename in it."""
    if os.name == "posix":  # Windows cannot open folders
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


START = hashlib.sha256(b"physment run").hexdigest()
"""Head of an empty hash chain."""


class Seal(Record):
    """Contents of `seal.json`."""

    format: Literal[1] = FORMAT
    lines: int = 0
    """Number of lines of `episodes.jsonl` in the hash chain, from the first line on."""
    head: str = START
    """SHA-256 of the previous head and the last line, in hexadecimal digits."""
    found: int = Field(default=0, exclude_if=is_absent)
    """Number of lines that no seal covered when a killed run was resumed; they were added to the chain unverified.
    Absent if there were none."""
    edited: tuple[str, ...] = Field(default=(), exclude_if=is_absent)
    """Why records were accepted that did not match an earlier seal; absent if all matched."""

    def after(self, line: bytes) -> "Seal":
        """Return the seal after one more record. `line` is the record's line without its line feed."""
        head = hashlib.sha256(self.head.encode() + hashlib.sha256(line).digest()).hexdigest()
        return self.model_copy(update={"lines": self.lines + 1, "head": head})

    def problem(self, lines: Iterable[bytes]) -> str:
        """Return, as a clause, why lines do not match the seal; empty if they do. Later lines are ignored."""
        found = Seal()
        for line in lines:
            if found.lines == self.lines:
                break
            found = found.after(line)
        if found.lines < self.lines:
            return f"{self.lines} episodes were sealed, and {found.lines} are there"
        return "" if found.head == self.head else "the sealed episodes have been changed"
