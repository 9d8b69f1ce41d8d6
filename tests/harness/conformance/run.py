"""Runs the official MCP conformance suite against a host and compares the results with the list of expected failures.

python -m tests.harness.conformance.run [--out FILE]
"""

import argparse
import contextlib
import json
import subprocess
import sys
from collections.abc import Generator, Sequence
from pathlib import Path

import httpx
from rich.console import Console

from tests.harness.conformance.judging import differences, page, read_expected
from tests.harness.conformance.suite import REVISIONS, SUITE, CannotRun, run_suite

EXPECTED = Path(__file__).parent / "expected.toml"
_SCENE = {"scene": 20, "seed": 0}


@contextlib.contextmanager
def host() -> Generator[str]:
    """Start a host as a user does; yields its address.

    Raises:
        CannotRun: The host does not start.
    """
    words = [sys.executable, "-m", "physment_mcp", "serve", "--port", "0"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            line = process.stdout.readline()
            if not line:
                raise CannotRun("the host did not start; it says why above")
            yield json.loads(line)["listening"]
        finally:
            process.terminate()


def main(argv: Sequence[str]) -> int:
    """Run the suite and print the results; returns 0 if they match the list."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="write the table there, if the results are those of the list")
    args = parser.parse_args(argv)
    console = Console(stderr=True)
    expected = read_expected(EXPECTED)
    found = {}
    try:
        with host() as address:
            for revision in REVISIONS:
                # A new episode for each protocol, because a scenario may end the episode.
                url = (
                    httpx.post(f"{address}/episodes", json=_SCENE, trust_env=False).raise_for_status().json()["mcp_url"]
                )
                with console.status(revision):
                    found[revision] = run_suite(url, revision)
                whole = sum(not result.failed for result in found[revision].values())
                console.print(f"{revision}: {whole} of {len(found[revision])} scenarios pass whole", highlight=False)
    except CannotRun as error:
        console.print(str(error), style="red", highlight=False, markup=False)
        return 1
    problems = differences(found, expected)
    for problem in problems:
        console.print(problem, style="red", highlight=False, markup=False, soft_wrap=True)
    if not problems:
        console.print("All that fails is in the list, and all that is in the list fails.", highlight=False)
        if args.out:
            args.out.write_text(page(found, expected, SUITE), encoding="utf-8")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
