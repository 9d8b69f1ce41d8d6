"""The seal of a run: a hash chain over its episodes, which reveals records that were edited or forged later.

While it plays, the evaluator keeps the chain in memory and never computes it from the files. At the end it prints the
head of the chain and writes it beside the records. A change of the files in between does not match the head. Anyone who
can write the run folder can also replace the seal; only the printed head reveals that.
"""

import hashlib
from collections.abc import Iterable
from typing import Literal

from pydantic import Field

from evaluator.records.episode import FORMAT, Record, is_absent

START = hashlib.sha256(b"physment run").hexdigest()
"""Head of an empty hash chain."""


class Seal(Record):
    """What `seal.json` holds."""

    format: Literal[1] = FORMAT
    lines: int = 0
    """Number of lines of `episodes.jsonl` that are sealed, from the first on."""
    head: str = START
    """SHA-256 of the head before the last line and of the last line, in hexadecimal digits."""
    found: int = Field(default=0, exclude_if=is_absent)
    """Lines among them that no seal stood for when the run was continued, because it had been killed: they are sealed
    as they were found. Absent if there were none."""
    edited: tuple[str, ...] = Field(default=(), exclude_if=is_absent)
    """Why the records that an earlier seal stood for were taken although they did not fit to it; absent if they did."""

    def after(self, line: bytes) -> "Seal":
        """The seal with one more line, given without its line feed."""
        head = hashlib.sha256(self.head.encode() + hashlib.sha256(line).digest()).hexdigest()
        return self.model_copy(update={"lines": self.lines + 1, "head": head})

    def problem(self, lines: Iterable[bytes]) -> str:
        """Why lines do not match the seal, as a clause; empty if they do. Further lines may follow the sealed ones."""
        found = Seal()
        for line in lines:
            if found.lines == self.lines:
                break
            found = found.after(line)
        if found.lines < self.lines:
            return f"{self.lines} episodes were sealed, and {found.lines} are there"
        return "" if found.head == self.head else "the sealed episodes have been changed"
