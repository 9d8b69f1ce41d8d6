"""Command line of the website: `python -m website`; `make docs` calls it in an environment that has Sphinx."""

import argparse
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from website.checks import faults
from website.pages import write_pages

ROOT = Path(__file__).parents[1]


def main(argv: Sequence[str] | None = None) -> int:
    """Build the site and check it; returns the exit code: 1 if a warning was given or a check failed."""
    parser = argparse.ArgumentParser("python -m website", description=__doc__)
    parser.add_argument("--out", type=Path, default=ROOT / "build", metavar="DIR", help="where to (default build)")
    args = parser.parse_args(argv)
    pages, site = args.out / "pages", args.out / "site"
    for folder in (pages, site):
        shutil.rmtree(folder, ignore_errors=True)
    try:
        shown = write_pages(ROOT, pages)
    except LookupError as fault:
        print(f"website: {fault}", file=sys.stderr)
        return 1
    # In a child process, because Sphinx changes global state. -W -n: warnings and unresolved references are errors;
    # --keep-going: report all of them.
    words = ("-W", "--keep-going", "-n", "-q", "-j", "auto", "-c", str(Path(__file__).parent), str(pages), str(site))
    if subprocess.run((sys.executable, "-m", "sphinx", *words), check=False).returncode != 0:  # noqa: S603 - ours
        return 1
    for name in shown:
        (site / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(pages / name, site / name)
    shutil.rmtree(site / ".doctrees", ignore_errors=True)
    found = faults(site)
    for fault in found:
        print(f"website: {fault}", file=sys.stderr)
    if not found:
        print(f"{site / 'index.html'}: {len(list(site.rglob('*.html')))} pages")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
