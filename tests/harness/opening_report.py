"""Measures how long a report takes to open in Chromium: its page, and a link to the notebook of one of its episodes.

python -m tests.harness.opening_report runs/mine/report.html --episode 2000
"""

import argparse
import statistics
import sys
import tempfile
import time
from pathlib import Path

from rich.console import Console

from tests.builders.chromium import Page, chromium, installed


def main() -> None:
    """Print the median wall time of each kind of opening, with its range."""
    parser = argparse.ArgumentParser(description="Measure how long a report takes to open in Chromium.")
    parser.add_argument("report", type=Path, help="the report.html of a run")
    parser.add_argument("--episode", type=int, default=1, metavar="N", help="the episode whose notebook is opened")
    parser.add_argument("--times", type=int, default=9, metavar="N", help="how often each is opened (default: 9)")
    args = parser.parse_args()
    program = installed()
    if program is None:
        sys.exit("Chromium is not installed, so nothing is measured: apt-get install chromium")
    anchor = f"#episode-{args.episode}"
    shown = f"document.querySelector({anchor!r})?.offsetHeight > 0"
    with tempfile.TemporaryDirectory() as made, chromium(program, Path(made, "profile")) as page:
        page.look(1280, "light")
        for name, address, condition in (("the page", "", "true"), ("a link to a notebook", anchor, shown)):
            taken = [_opened(page, args.report, address, condition) for _ in range(args.times)]
            spread = f"{min(taken):.2f} to {max(taken):.2f}"
            Console().print(f"{name}: {statistics.median(taken):.2f} s, {spread} s, {args.times} times")


def _opened(page: Page, report: Path, anchor: str, condition: str) -> float:
    """Return the wall time until the page is loaded and the condition is true [s]."""
    start = time.perf_counter()
    page.open(report, anchor)
    page.wait(condition)
    return time.perf_counter() - start


if __name__ == "__main__":
    main()
