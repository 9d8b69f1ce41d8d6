"""Isolation of an external program: its environment variables, the folders of an episode, and its system user."""

import contextlib
import os
import shutil
import subprocess
import tempfile
from collections.abc import AsyncGenerator, Generator, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import anyio.to_thread

from evaluator.errors import UsageError
from scenes import default_folder

_KILL_ALL = ("/bin/sh", "-c", "kill -s KILL -- -1")
"""Command that kills every other process of the user that runs it."""


@dataclass(frozen=True, slots=True)
class SystemUser:
    """A user of this machine."""

    uid: int
    gid: int


class SystemUsers:
    """A pool of system users, each of whom runs at most one program at a time."""

    def __init__(self, users: Sequence[SystemUser] = ()) -> None:
        """Create the pool.

        Args:
            users: Users of the pool; empty if programs run as the user of this process.
        """
        self._count = len(users)
        self._free = list(users)
        self._places = anyio.Semaphore(len(users), fast_acquire=True)

    @contextlib.asynccontextmanager
    async def one(self) -> AsyncGenerator[SystemUser | None]:
        """Lend a user of the pool and kill its processes afterwards; yields None if the pool is empty."""
        if not self._count:
            yield None
            return
        async with self._places:
            user = self._free.pop()
            try:
                yield user
            finally:
                with anyio.CancelScope(shield=True):
                    await anyio.to_thread.run_sync(end_processes_of, user)
                self._free.append(user)


def system_users(names: Sequence[str]) -> list[SystemUser]:
    """Look up system users by name or number.

    Raises:
        UsageError: A user is unknown, is root or the user of this process, or this process does not run as root.
    """
    if not names:
        return []
    if find_spec("pwd") is None or os.geteuid() != 0:
        raise UsageError("--sealed-users: only root can start programs as other users")
    if len(set(names)) < len(names):
        raise UsageError("--sealed-users: a user is named twice")
    return [_user(name) for name in names]


def _user(name: str) -> SystemUser:
    import pwd  # noqa: PLC0415 - Windows has none

    try:
        entry = pwd.getpwuid(int(name)) if name.isdecimal() else pwd.getpwnam(name)
    except (KeyError, OverflowError):
        raise UsageError(f"--sealed-users: there is no user {name!r} on this machine") from None
    if entry.pw_uid in {0, os.getuid(), os.geteuid()}:
        raise UsageError(f"--sealed-users: {name} runs this program, so it can read the scene packs")
    return SystemUser(entry.pw_uid, entry.pw_gid)


def end_processes_of(user: SystemUser) -> None:
    """Kill every process of a user, including those that left the program's process group."""
    subprocess.run(_KILL_ALL, user=user.uid, group=user.gid, extra_groups=[], check=False)  # noqa: S603 - our own script


_OWN_VARIABLES = {"PWD", "OLDPWD", "PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV", "CONDA_PREFIX", "_"}
_OWN_PREFIXES = ("PHYSMENT", "PYTEST", "XDG_")
URL = "PHYSMENT_MCP_URL"
"""Environment variable with the address of the program's episode."""
TOKEN = "PHYSMENT_MCP_TOKEN"  # noqa: S105 - a name, not a token
"""Environment variable with the bearer token for this address, if it requires one."""


def child_environment(ours: Mapping[str, str], scenes_dir: Path | None) -> dict[str, str]:
    """Return an environment that does not reveal the location of the packs or of this program.

    Args:
        ours: The environment to filter.
        scenes_dir: Folder of the packs; None for the packs of the suite.
    """
    folders = [str(folder) for folder in (scenes_dir and scenes_dir.absolute(), default_folder().parent) if folder]

    def names_a_folder(value: str) -> bool:
        return any(folder in value for folder in folders)

    path = os.pathsep.join(part for part in ours.get("PATH", os.defpath).split(os.pathsep) if not names_a_folder(part))
    kept = {
        name: value
        for name, value in ours.items()
        if name not in _OWN_VARIABLES and not name.startswith(_OWN_PREFIXES) and not names_a_folder(value)
    }
    return kept | {"PATH": path}


@dataclass(frozen=True, slots=True)
class EpisodeFolders:
    """The folders in which an external program runs."""

    base: Path
    """Parent of all other folders; only the program's user can enter it."""

    @property
    def config(self) -> Path:
        """The MCP client configuration file."""
        return self.base / "mcp.json"

    @property
    def work(self) -> Path:
        """The working directory."""
        return self.base / "work"

    @property
    def home(self) -> Path:
        """The home directory."""
        return self.base / "home"

    @property
    def temporary(self) -> Path:
        """The directory for temporary files."""
        return self.base / "tmp"

    def variables(self) -> dict[str, str]:
        """Return the environment variables that point to the home and temporary directories."""
        temporary = dict.fromkeys(("TMPDIR", "TMP", "TEMP"), str(self.temporary))
        return {"HOME": str(self.home), "USERPROFILE": str(self.home), **temporary}


@contextlib.contextmanager
def episode_folders(home: Path | None, user: SystemUser | None) -> Generator[EpisodeFolders]:
    """Create the folders of an episode, and remove them afterwards.

    Args:
        home: Template folder copied into the home folder; None for an empty home.
        user: Owner of the folders; None for the user of this process.
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
    """Make a user the owner of everything in a folder."""
    for place, folders, files in os.walk(base):
        for name in (".", *folders, *files):
            os.chown(Path(place) / name, user.uid, user.gid, follow_symlinks=False)
