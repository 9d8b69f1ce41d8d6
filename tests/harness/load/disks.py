"""Mounts a small file system on a folder, to fill it or make it read-only. Linux; needs permission to mount."""

import contextlib
import functools
import os
import subprocess
import tempfile
from collections.abc import Generator
from pathlib import Path

_SIZE = 2**25
"""Size of the file system [bytes]: enough for any run that is played on it."""
_BALLAST = "ballast"
"""Name of the file that fills the file system."""


@contextlib.contextmanager
def mounted(folder: Path) -> Generator[None]:
    """Mount an in-memory file system on an empty folder, and unmount it with all its files at the end.

    Raises:
        OSError: This process may not mount.
    """
    _mount("-t", "tmpfs", "-o", f"size={_SIZE}", "tmpfs", str(folder))
    try:
        yield
    finally:
        # Lazily, because a killed process may still have files open in the folder while it ends.
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


@functools.cache
def may_mount() -> bool:
    """Whether this process may mount file systems."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            with mounted(Path(folder)):
                return True
        except OSError:
            return False


def fill(folder: Path, left: int) -> None:
    """Fill the file system except for `left` bytes, rounded up to whole pages."""
    state = os.statvfs(folder)
    with (folder / _BALLAST).open("wb") as stream:
        os.posix_fallocate(stream.fileno(), 0, max(1, state.f_bavail * state.f_frsize - left))


def empty(folder: Path) -> None:
    """Free the space that `fill` used."""
    (folder / _BALLAST).unlink()


def turn(folder: Path, mode: str) -> bool:
    """Make the file system read-only (`ro`) or writable (`rw`); False while a file on it is open for writing."""
    try:
        _mount("-o", f"remount,{mode}", str(folder))
    except OSError:
        return False
    return True


def _mount(*words: str) -> None:
    done = subprocess.run(["mount", *words], capture_output=True, text=True, check=False)
    if done.returncode:
        raise OSError(done.stderr.strip())
