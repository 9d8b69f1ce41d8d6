"""Runs the programs that a release is made with: git, make, pip, and what was installed."""

import subprocess
from collections.abc import Mapping
from pathlib import Path


class ReleaseError(Exception):
    """The release cannot go on; the message is for the person who started it."""


def output(*words: str, cwd: Path, env: Mapping[str, str] | None = None) -> str:
    """What a program prints.

    Args:
        words: The command.
        cwd: Folder to run it in.
        env: Its environment; ours by default.

    Raises:
        ReleaseError: It failed; the message holds what it printed.
    """
    done = subprocess.run(  # noqa: S603 - the words are ours
        words, cwd=cwd, env=env, stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False
    )
    if done.returncode != 0:
        raise ReleaseError(f"`{' '.join(words)}` failed:\n{done.stdout}{done.stderr}".rstrip())
    return done.stdout


def show(*words: str, cwd: Path) -> None:
    """Run a program whose output the reader should see while it runs.

    Raises:
        ReleaseError: It failed.
    """
    if subprocess.run(words, cwd=cwd, check=False).returncode != 0:  # noqa: S603 - the words are ours
        raise ReleaseError(f"`{' '.join(words)}` failed")
