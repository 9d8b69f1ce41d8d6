"""Creates an environment for each MuJoCo version in `.engines/`; all other packages are the locked ones."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[3]
LOCK = ROOT / "requirements.lock"
_READY = "ready"
"""File that is written last; an environment without it is incomplete."""


class CannotInstall(Exception):
    """An engine cannot be installed here; the message says why."""


def without_engine(lock: str) -> str:
    """The text of a lock file without MuJoCo and its hashes."""
    return re.sub(r"^mujoco==.*\n(?:[ \t]+.*\n)*", "", lock, flags=re.MULTILINE)


def versions_of(lock: str) -> str:
    """Return the packages of a lock file with their versions and Python markers, without hashes."""
    return "".join(f"{line.strip()}\n" for line in re.findall(r"^[\w.-]+==[^\\\n]+", lock, flags=re.MULTILINE))


def environment_of(engine: str, python: str) -> Path:
    """Return the interpreter of an engine's environment. Creates it if it is missing or older than the lock.

    Args:
        engine: Version of MuJoCo.
        python: Interpreter that creates it.

    Raises:
        CannotInstall: It cannot be created.
    """
    name = engine if python == sys.executable else f"{engine}-{Path(python).name}"
    folder = ROOT / ".engines" / name
    interpreter, ready = folder / "bin" / "python", folder / _READY
    if ready.exists() and ready.stat().st_mtime > LOCK.stat().st_mtime:
        return interpreter
    shutil.rmtree(folder, ignore_errors=True)
    _run(python, "-m", "venv", str(folder))
    locked = folder / "requirements.txt"
    locked.write_text(without_engine(LOCK.read_text(encoding="utf-8")), encoding="utf-8")
    pip = (str(interpreter), "-m", "pip", "install", "--quiet", "--disable-pip-version-check")
    _run(*pip, "--no-deps", "--require-hashes", "-r", str(locked))
    # Without constraints, pip could replace a locked package by another version, to meet a requirement of the engine.
    versions = folder / "constraints.txt"
    versions.write_text(versions_of(locked.read_text(encoding="utf-8")), encoding="utf-8")
    _run(*pip, "-c", str(versions), f"mujoco=={engine}")
    # The package declares the engine on which it is certified, and the Pythons on which it was tried.
    _run(*pip, "--no-deps", "--no-build-isolation", "--ignore-requires-python", "-e", str(ROOT))
    ready.touch()
    return interpreter


def _run(*words: str) -> None:
    try:
        done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=900)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise CannotInstall(f"{words[0]} cannot be run: {error}") from error
    if done.returncode:
        said = [line for line in done.stderr.splitlines() if line.startswith("ERROR")] or done.stderr.splitlines()[-1:]
        raise CannotInstall(f"{' '.join(words[1:4])}: {said[0] if said else done.returncode}")
