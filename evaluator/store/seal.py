"""The seal of a run: a hash chain over its episodes, which reveals records that were edited or forged later.

During a run, the evaluator keeps the chain in memory and never computes it from the files. At the end it prints the
head of the chain and writes it beside the records. Records that were changed in between do not match the head. Anyone
who can write the run folder can also replace the stored seal; only the printed head reveals that.
"""

import hashlib
from collections.abc import Iterable
from typing import Literal

from pydantic import Field

from evaluator.records.episode import FORMAT, Record, is_absent

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
