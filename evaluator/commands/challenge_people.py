"""Files about the participants of a challenge: their codes, the hashes of their links, and when they consented.

They contain no names. `challenge --forget` deletes the episodes of one person and everything derived from them.
"""

import csv
import io
import os
import shutil
from collections.abc import Iterable
from pathlib import Path
from typing import Literal, Self

from pydantic import Field, ValidationError
from rich.console import Console

from evaluator.agents.browser.app import hash_of
from evaluator.answers.keys import KeyRing
from evaluator.commands.base import page_token
from evaluator.commands.finishing import finish
from evaluator.errors import StoreError, UsageError, reason_of
from evaluator.records.episode import Record, timestamp
from evaluator.store.run_folder import RunFolder

MOST_PEOPLE = 500
"""Largest number of people in one challenge."""


class Person(Record):
    """One participant."""

    number: int
    """Number of the person, which is also the `epoch` of all their episodes."""
    token_sha256: str
    """SHA-256 of the token in the person's link; empty once their data are deleted."""
    agreed_at: str | None = None
    """When the person consented; None before."""


class Challenge(Record):
    """`challenge.json`: the settings and participants of a challenge, which `run.json` does not contain."""

    format: Literal[1] = 1
    minutes: float | None = Field(default=None, gt=0)
    """Time limit of each person, counted from their consent [min]; None without a limit."""
    feedback: bool = False
    """Whether people learn after each scene whether their answer was right."""
    organiser: str
    """Contact whom participants ask to delete their data."""
    people: tuple[Person, ...]

    def code(self, number: int) -> str:
        """The code of a person: the number, with leading zeros."""
        return f"{number:0{max(2, len(str(len(self.people))))}}"

    def consent(self, number: int) -> str:
        """The sentence to which a person consents."""
        return (
            f"I take part of my own free will: my calls, my answers and their times are stored under the code"
            f" {self.code(number)}, without my name, and are deleted if I give this code to {self.organiser}."
        )

    def person(self, code: str) -> Person:
        """Find a person by the code.

        Raises:
            UsageError: No participant has this code, or their data have been deleted.
        """
        found = [one for one in self.people if code.isdecimal() and one.number == int(code)]
        if not found:
            last = self.code(len(self.people))
            raise UsageError(f"--forget {code}: nobody has this code; the codes are {self.code(1)} to {last}")
        if not found[0].token_sha256:
            raise UsageError(f"--forget {code}: the data of this person are deleted already")
        return found[0]

    def changed(self, person: Person) -> Self:
        """Return a copy of the record with one person replaced."""
        people = (person if one.number == person.number else one for one in self.people)
        return self.model_copy(update={"people": tuple(people)})


def challenge_file(folder: RunFolder) -> Path:
    """Path of `challenge.json`."""
    return folder.path / "challenge.json"


def read_challenge(folder: RunFolder) -> Challenge | None:
    """Read `challenge.json`; None if the folder has none.

    Raises:
        StoreError: The file is damaged.
    """
    file = challenge_file(folder)
    try:
        return Challenge.model_validate_json(file.read_bytes()) if file.exists() else None
    except (OSError, ValidationError) as error:
        raise StoreError(f"{file} cannot be read: {reason_of(error)}") from error


def write_challenge(folder: RunFolder, challenge: Challenge) -> None:
    """Write `challenge.json`."""
    folder.write_text(challenge_file(folder), challenge.model_dump_json(indent=2) + "\n")


def agreed(person: Person) -> Person:
    """Return a copy of the person with the present time as the time of consent."""
    return person.model_copy(update={"agreed_at": timestamp("seconds")})


def links_file(folder: RunFolder) -> Path:
    """Path of the table of links, beside the run folder, so that the folder can be passed on without them."""
    return folder.path.with_name(f"{folder.path.name}-links.csv")


def with_tokens(folder: RunFolder, challenge: Challenge) -> tuple[Challenge, dict[int, str]]:
    """Return the challenge and the token of each person.

    New tokens are made if the table of links is missing or belongs to another challenge.
    """
    tokens = _stored_tokens(links_file(folder))
    people: list[Person] = []
    found: dict[int, str] = {}
    for person in challenge.people:
        token = tokens.get(person.number, "")
        if not person.token_sha256:  # deleted
            people.append(person)
            continue
        if hash_of(token) != person.token_sha256:
            token = page_token()
        found[person.number] = token
        people.append(person.model_copy(update={"token_sha256": hash_of(token)}))
    return challenge.model_copy(update={"people": tuple(people)}), found


def write_links(folder: RunFolder, challenge: Challenge, tokens: dict[int, str], address: str) -> Path:
    """Write the table of links, readable only by its owner.

    Args:
        folder: The run folder.
        challenge: The challenge.
        tokens: Number of a person → token.
        address: Address of the pages, without a slash at its end.

    Raises:
        StoreError: The file cannot be written.
    """
    _write_rows(links_file(folder), [(challenge.code(number), f"{address}/{tokens[number]}/") for number in tokens])
    return links_file(folder)


def remove_link(folder: RunFolder, code: str) -> None:
    """Remove a person from the table of links, if there is one.

    Raises:
        StoreError: The file cannot be read or written.
    """
    file = links_file(folder)
    if file.exists():
        _write_rows(file, [row for row in _stored_rows(file) if row[0] != code])


def _write_rows(file: Path, rows: Iterable[tuple[str, str]]) -> None:
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerows([("code", "link"), *rows])
    try:
        file.unlink(missing_ok=True)
        with os.fdopen(os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as stream:
            stream.write(text.getvalue())
    except OSError as error:
        raise StoreError(f"{file} cannot be written: {error.strerror}") from error


def _stored_tokens(file: Path) -> dict[int, str]:
    return {int(code): link.rstrip("/").rpartition("/")[2] for code, link in _stored_rows(file)}


def _stored_rows(file: Path) -> list[tuple[str, str]]:
    """Return code and link of each person in the table; empty if there is no table."""
    try:
        rows = list(csv.reader(io.StringIO(file.read_text(encoding="utf-8"))))[1:] if file.exists() else []
        return [(f"{int(code):0{len(code)}}", link) for code, link in rows]
    except (OSError, ValueError) as error:
        raise StoreError(f"{file} is no table of links; remove it to give everyone a new link") from error


_RECORDS = {"run.json", "challenge.json", "episodes.jsonl"}
_DERIVED = {
    *(
        "grades.jsonl",
        "summary.json",
        "report.html",
        "report_episodes",
        "films",
        "film.js",
        "webp",
        "figures",
        "frames",
    ),
    *("evidence.jsonl", "exchanges.parquet", "inspect", "seal.json", "running.json", "episodes.jsonl.torn"),
}
"""Files and folders that are derived from the records and can be made again."""
_DERIVED_NAMES = ("grades.*.jsonl", "tables*.csv", "tables.*", "evidence.jsonl.torn")


def remove_person(folder: RunFolder, challenge: Challenge, code: str, keys: KeyRing, console: Console) -> None:
    """Delete the episodes of a person and all files derived from episodes; then grade the remaining episodes again.

    Raises:
        UsageError: No participant has this code.
        StoreError: The challenge is running, or a file cannot be written.
    """
    person = challenge.person(code)
    with folder.held():
        removed = folder.keep_episodes(lambda key: key.epoch != person.number)
        for name in sorted(_DERIVED):
            _remove(folder.path / name)
        for pattern in _DERIVED_NAMES:
            for file in folder.path.glob(pattern):
                _remove(file)
        challenge = challenge.changed(person.model_copy(update={"token_sha256": "", "agreed_at": None}))
        write_challenge(folder, challenge)
        remove_link(folder, challenge.code(person.number))
    console.print(f"deleted what {challenge.code(person.number)} did: {removed} records; the link leads nowhere now")
    others = sorted({file.name for file in folder.path.iterdir()} - _RECORDS)
    if others:
        console.print(f"look yourself at what else is in {folder.path}: {', '.join(others)}", soft_wrap=True)
    if folder.episodes():
        finish(folder, keys, console, as_json=False)


def _remove(path: Path) -> None:
    if path.is_symlink() or path.is_file():
        path.unlink()
    elif path.is_dir():
        shutil.rmtree(path)
