"""System users that sealed programs run as, one for each episode at a time, so that they cannot reach each other."""

import contextlib
import os
import subprocess
from collections.abc import AsyncGenerator, Sequence
from importlib.util import find_spec
from typing import NamedTuple

import anyio
import anyio.to_thread

from evaluator.errors import UsageError

_KILL_ALL = ("/bin/sh", "-c", "kill -s KILL -- -1")
"""Run as a user, this ends every other process of that user."""


class SystemUser(NamedTuple):
    """A user of this machine."""

    uid: int
    gid: int


class SystemUsers:
    """Users, each of whom runs at most one program at a time."""

    def __init__(self, users: Sequence[SystemUser] = ()) -> None:
        """Set up.

        Args:
            users: None of them if programs run as the user of this process.
        """
        self._count = len(users)
        self._free = list(users)
        self._places = anyio.Semaphore(len(users), fast_acquire=True)

    @contextlib.asynccontextmanager
    async def one(self) -> AsyncGenerator[SystemUser | None]:
        """A user who runs nothing, and who runs nothing afterwards; None for the user of this process."""
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
    """The users with these names or numbers.

    Raises:
        UsageError: There is no such user, it is root or the user of this process, or this process is not root.
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
    """End every process of a user, also those that left the group of the program that started them."""
    subprocess.run(_KILL_ALL, user=user.uid, group=user.gid, extra_groups=[], check=False)  # noqa: S603 - our own script
