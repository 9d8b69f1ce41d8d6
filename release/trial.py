"""Installs the wheel as a user would, in a new environment, and plays scenes with it far from the checkout."""

import json
import os
import venv
from pathlib import Path

from release.distributions import PACKAGES
from release.process import ReleaseError, output

SCENES = "7-9"
TOOLS = ("uv==0.13.9", "pipx==1.18.4")
"""What makes an environment for one command, in the versions that are tried."""


def try_wheel(wheel: Path, lock: Path, place: Path) -> str:
    """Install the locked dependencies and the wheel, then run both commands from an empty folder.

    Args:
        wheel: The wheel.
        lock: The locked dependencies, with hashes.
        place: An empty folder for the environment and what the commands write.

    Returns:
        One line that says what was tried.

    Raises:
        ReleaseError: It cannot be installed, a command fails, or the reference agent does not solve the scenes.
    """
    environment, away = place / "environment", place / "away"
    venv.create(environment, with_pip=True)
    away.mkdir()
    programs = environment / "bin"

    def run(program: str, *words: str) -> str:
        # Without PYTHONPATH, so that nothing but the environment can be imported.
        env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        return output(str(programs / program), *words, cwd=away, env=env)

    run("python", "-m", "pip", "install", "--quiet", "--require-hashes", "--requirement", str(lock))
    run("python", "-m", "pip", "install", "--quiet", "--no-deps", str(wheel))
    code = f"import {', '.join(PACKAGES)}; print({', '.join(f'{name}.__file__' for name in PACKAGES)}, sep='\\n')"
    for file in run("python", "-c", code).splitlines():
        if not Path(file).is_relative_to(environment):
            raise ReleaseError(f"{file} was imported instead of the wheel's")
    for command in ("physment-mcp", "physment-eval"):
        run(command, "--help")
    run("physment-eval", "--server", "stdio", "--scenes", SCENES, "--out", "run")
    overall = json.loads((away / "run" / "summary.json").read_text(encoding="utf-8"))["overall"]
    if (overall["n_correct"], overall["n"]) != (3, 3):
        raise ReleaseError(
            f"the reference agent solved {overall['n_correct']} of {overall['n']} scenes instead of 3 of 3"
        )
    return f"{wheel.name} works outside the checkout: both commands start, scenes {SCENES} are solved over stdio"


def try_one_liners(wheel: Path, place: Path) -> str:
    """Run the commands of docs/how-to/install.md with uvx and pipx, which choose the newest dependencies that fit.

    Args:
        wheel: The wheel.
        place: A folder for their environments and what the commands write.

    Returns:
        One line that says what was tried.

    Raises:
        ReleaseError: A command fails.
    """
    tools, away = place / "tools", place / "away-from-tools"
    venv.create(tools, with_pip=True)
    away.mkdir()
    env = {name: value for name, value in os.environ.items() if name not in {"PYTHONPATH", "VIRTUAL_ENV"}}
    env |= {"UV_CACHE_DIR": str(place / "uv"), "PIPX_HOME": str(place / "pipx"), "PIPX_BIN_DIR": str(place / "bin")}

    def run(program: str, *words: str) -> str:
        return output(str(tools / "bin" / program), *words, cwd=away, env=env)

    run("python", "-m", "pip", "install", "--quiet", *TOOLS)
    version = run("uvx", "--from", str(wheel), "physment-mcp", "--version")
    run("uvx", "--from", str(wheel), "physment-eval", "--server", "stdio", "--scenes", "7", "--out", "run")
    if run("pipx", "run", "--spec", str(wheel), "physment-mcp", "--version") != version:
        raise ReleaseError("uvx and pipx start different versions of physment-mcp")
    return f"{wheel.name} also works through uvx and pipx: {version.strip()}, scene 7 is solved"
