"""`challenge --forget`: deletes the episodes of one person and everything derived from them."""

import shutil
from pathlib import Path

from rich.console import Console

from evaluator.answers.keys import KeyRing
from evaluator.commands.challenge_people import Challenge, remove_link, write_challenge
from evaluator.commands.finishing import finish
from evaluator.store.run_folder import RunFolder

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
