"""The folders of one episode of an external program: nothing is there before, and nothing is left afterwards."""

import contextlib
import os
import shutil
import tempfile
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path

from evaluator.agents.external.system_users import SystemUser


@dataclass(frozen=True, slots=True)
class EpisodeFolders:
    """Where a program runs."""

    base: Path
    """Holds all the others; only the program's user can enter it."""

    @property
    def config(self) -> Path:
        """The configuration of the client."""
        return self.base / "mcp.json"

    @property
    def work(self) -> Path:
        """The working folder."""
        return self.base / "work"

    @property
    def home(self) -> Path:
        """The home."""
        return self.base / "home"

    @property
    def temporary(self) -> Path:
        """The folder for temporary files."""
        return self.base / "tmp"

    def variables(self) -> dict[str, str]:
        """The environment variables that name them."""
        temporary = dict.fromkeys(("TMPDIR", "TMP", "TEMP"), str(self.temporary))
        return {"HOME": str(self.home), "USERPROFILE": str(self.home), **temporary}


@contextlib.contextmanager
def episode_folders(home: Path | None, user: SystemUser | None) -> Generator[EpisodeFolders]:
    """New folders, which are removed afterwards.

    Args:
        home: Folder whose content the home starts with; None for an empty home.
        user: Whose they are; None for the user of this process.
    """
    with tempfile.TemporaryDirectory(prefix="episode-", ignore_cleanup_errors=True) as base:
        folders = EpisodeFolders(Path(base))
        folders.work.mkdir()
        folders.temporary.mkdir()
        folders.config.touch(mode=0o600)
        if home is None:
            folders.home.mkdir()
        else:
            shutil.copytree(home, folders.home, symlinks=True)
        if user is not None:
            _give(folders.base, user)
        yield folders


def _give(base: Path, user: SystemUser) -> None:
    """Make everything in a folder the user's own."""
    for place, folders, files in os.walk(base):
        for name in (".", *folders, *files):
            os.chown(Path(place) / name, user.uid, user.gid, follow_symlinks=False)
