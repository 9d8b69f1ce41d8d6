"""Runs the official MCP conformance suite as a program and reads its results."""

import json
import re
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

SUITE = "@modelcontextprotocol/conformance@0.2.0-alpha.12"
"""The newest release; 0.1.16, the last one without a suffix, does not support protocol 2026-07-28."""
NODE = "node@22.23.3"
REVISIONS = ("2025-06-18", "2025-11-25", "2026-07-28")
"""Protocols that are tested: two with sessions, and the stateless one."""
_PATIENCE_S = 600.0
"""Timeout for one protocol, with the download [s]."""
_STAMP = re.compile(r"-\d{4}-\d{2}-\d{2}T[\d-]+Z$")
_ANNOUNCED = re.compile(r"\((\d+) scenarios\)")


class CannotRun(Exception):
    """The suite did not run to its end; the message says why."""


@dataclass(frozen=True, slots=True)
class Result:
    """The result of a scenario."""

    passed: int
    """Number of checks that passed."""
    failed: frozenset[str]
    """Ids of the checks that failed."""


def run_suite(url: str, revision: str) -> dict[str, Result]:
    """Run every server scenario of a protocol, except those of extensions.

    Args:
        url: The MCP endpoint.
        revision: The date of the protocol version.

    Returns:
        Scenario → its result.

    Raises:
        CannotRun: npx is missing, the suite cannot be installed, or it did not run all announced scenarios.
    """
    with tempfile.TemporaryDirectory() as folder:
        words = ["npx", "--yes", f"--package={NODE}", f"--package={SUITE}", "--", "conformance", "server"]
        options = ["--url", url, "--suite", "all", "--spec-version", revision, "--output-dir", folder]
        try:
            # The exit code is ignored: each scenario is compared with the list.
            done = subprocess.run([*words, *options], capture_output=True, text=True, check=False, timeout=_PATIENCE_S)
        except FileNotFoundError:
            raise CannotRun("npx is not installed; it comes with Node.js") from None
        except subprocess.TimeoutExpired:
            raise CannotRun(f"{SUITE} did not end in {_PATIENCE_S:g} s") from None
        announced = _ANNOUNCED.search(done.stdout)
        if announced is None:
            said = [line for line in (done.stderr + done.stdout).splitlines() if line.strip()]
            raise CannotRun(f"{SUITE} did not start: {said[-1] if said else done.returncode}")
        results = read_results(Path(folder))
    if len(results) != int(announced[1]):
        raise CannotRun(f"{SUITE} announced {announced[1]} scenarios for {revision} and reported {len(results)}")
    return results


def read_results(folder: Path) -> dict[str, Result]:
    """Read the suite's output: a folder for each scenario, with its checks."""
    return {
        _STAMP.sub("", file.parent.name).removeprefix("server-"): _result(file)
        for file in sorted(folder.glob("*/checks.json"))
    }


def _result(file: Path) -> Result:
    checks = json.loads(file.read_text(encoding="utf-8"))
    return Result(
        passed=sum(check["status"] == "SUCCESS" for check in checks),
        failed=frozenset(check["id"] for check in checks if check["status"] == "FAILURE"),
    )
