"""The seal of a run: a chained checksum of its episodes, so that a record edited or forged later is found.

The checksum is kept in the memory of the evaluator while it plays, and is never computed from what is on disk. At the
end it is printed and written beside the records. A change made meanwhile, by whomever, no longer fits to it. Whoever
can write the run folder can write a new seal, too: then only the checksum that was printed tells.
"""

import hashlib
from collections.abc import Iterable
from typing import Literal

from pydantic import Field

from evaluator.records.episode import FORMAT, Record, is_absent

START = hashlib.sha256(b"physment run").hexdigest()
"""Head of a chain without lines."""


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
        """The seal once a line has been added, without its line feed."""
        head = hashlib.sha256(self.head.encode() + hashlib.sha256(line).digest()).hexdigest()
        return self.model_copy(update={"lines": self.lines + 1, "head": head})

    def problem(self, lines: Iterable[bytes]) -> str:
        """Why these lines are not the sealed ones, as a clause; empty if they are, or if more follow them."""
        found = Seal()
        for line in lines:
            if found.lines == self.lines:
                break
            found = found.after(line)
        if found.lines < self.lines:
            return f"{self.lines} episodes were sealed, and {found.lines} are there"
        return "" if found.head == self.head else "the sealed episodes have been changed"
