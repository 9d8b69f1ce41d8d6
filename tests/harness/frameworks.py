"""Installs third-party frameworks in separate environments, and runs the tests that need them.

python -m tests.harness.frameworks NAME...    verifiers, openenv, nemo_gym, trl, atropos, harbor, inspect, ray or lowest

The frameworks pin versions of mcp that conflict with ours and with each other. `lowest` runs the whole suite with the
oldest versions that pyproject.toml allows; it needs uv. This module imports the standard library only.
"""

import argparse
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parents[2]
PLACE = ROOT / ".integrations"
CLIENTS = ("verifiers", "openenv", "nemo_gym", "trl")
"""Frameworks whose packages, in `integrations/`, play through the referee."""
_NEWEST_FIRST = ("python3.13", "python3.12", "python3.11")
_BUILD_ONLY_OURS = ("--only-binary", ":all:", "--no-binary", "physment-mcp", "--no-binary", "physment-harbor")
"""Build only this project from source: an old sdist may need a compiler, or a build tool that is gone."""


def run(*words: str | Path) -> int:
    """Run a command in the checkout; returns its exit code."""
    print("+", *words, flush=True)  # noqa: T201 - a command that says what it runs
    return subprocess.run([*map(str, words)], cwd=ROOT, check=False).returncode


def installed(name: str, *packages: str) -> Path | None:
    """Create an environment with packages and the newest Python; returns its interpreter, None if that fails.

    NeMo Gym and Harbor, for example, need Python 3.12.
    """
    folder = PLACE / name
    python = folder / "bin" / "python"
    if python.exists():
        return python
    newest = next(filter(_runs, _NEWEST_FIRST), sys.executable)
    if run(newest, "-m", "venv", folder) or run(python, "-m", "pip", "install", "--quiet", *packages):
        shutil.rmtree(folder, ignore_errors=True)
        return None
    return python


def _runs(python: str) -> bool:
    """Return whether an interpreter runs; with pyenv, a program exists also for versions that are not selected."""
    return (
        shutil.which(python) is not None
        and not subprocess.run([python, "-c", ""], capture_output=True, check=False).returncode
    )


def tested(python: str | Path, *tests: str) -> int:
    """Run tests with an interpreter."""
    return run(python, "-m", "pytest", "-rs", *tests)


def client(name: str) -> int:
    """Test the package of a framework that plays through the referee; skipped if it cannot be installed."""
    # The extra `in-process`, and what transformers needs for weights in the GGUF format.
    ours = ("-e", ".", "gguf") if name == "trl" else ()
    installed(name, "-e", "integrations/client", "-e", f"integrations/{name}", *ours, "uv", "pytest")
    return tested(sys.executable, f"tests/integrations/test_{name}.py")


def atropos() -> int:
    """Test the environment for Atropos of docs/how-to/atropos.md; skipped if Atropos cannot be installed."""
    installed("atropos", "-e", "integrations/client", "atroposlib==0.4.0")
    return tested(sys.executable, "tests/integrations/test_atropos.py")


def harbor() -> int:
    """Export the suite as Harbor tasks into build/harbor, and let Harbor read them and run trials."""
    installed("harbor", "harbor>=0.24,<0.25")
    shutil.rmtree(ROOT / "build" / "harbor", ignore_errors=True)
    return run(sys.executable, "-m", "evaluator", "harbor", "write", "build/harbor") or tested(
        sys.executable, "tests/integrations/test_harbor_tasks.py", "tests/integrations/test_harbor.py"
    )


def inspect() -> int:
    """Test the plugin for Inspect AI in an environment with Inspect AI: it plays, grades, and reads logs."""
    python = installed("inspect", "-e", ".", "-e", "integrations/inspect", "openai==3.52.0", "pytest", "hypothesis")
    tests = ("tests/integrations/test_inspect_task.py", "tests/integrations/test_inspect_log.py")
    return 1 if python is None else tested(python, *tests)


def ray() -> int:
    """Install Ray beside this interpreter, and test `--executor ray` on a cluster of several nodes on this machine."""
    return run(sys.executable, "-m", "pip", "install", "--quiet", "--no-build-isolation", "-e", ".[ray]") or tested(
        sys.executable, "tests/evaluator/study/ray_cluster"
    )


def lowest() -> int:
    """Run the suite with the oldest versions that pyproject.toml allows, in .lowest."""
    oldest = ("--resolution", "lowest-direct", *_BUILD_ONLY_OURS, "--group", "dev")
    ours = ("-e", ".[models,report]", "-e", "integrations/harbor")
    return (
        run("uv", "venv", "--quiet", "--clear", "--python", sys.executable, ".lowest")
        or run("uv", "pip", "install", "--quiet", "--python", ".lowest", *oldest, *ours)
        or tested(".lowest/bin/python", "-n", "auto", "--dist", "worksteal")
    )


OTHERS = {"atropos": atropos, "harbor": harbor, "inspect": inspect, "ray": ray, "lowest": lowest}


def main(argv: Sequence[str]) -> int:
    """Install and test; returns 0 if all tests passed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="+", choices=(*CLIENTS, *OTHERS), metavar="NAME")
    names = parser.parse_args(argv).names
    codes = [client(name) if name in CLIENTS else OTHERS[name]() for name in names]
    return max(codes)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
