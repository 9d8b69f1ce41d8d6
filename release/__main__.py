"""Command line of the release: `python -m release build`, `trial` or `prepare`; the Makefile calls it."""

import argparse
import shutil
import sys
import tempfile
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from release import distributions
from release.preparation import Release, prepare
from release.process import ReleaseError
from release.trial import try_wheel

ROOT = Path(__file__).parents[1]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    parser = argparse.ArgumentParser("python -m release", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("build", help="build sdist and wheel into dist/ and check which files are in them")
    commands.add_parser("trial", help="build both, install the wheel in a new environment, play three scenes with it")
    preparing = commands.add_parser("prepare", help="prepare a release; pushes nothing")
    preparing.add_argument("version", help="X.Y.Z, newer than the last release")
    preparing.add_argument("--dry-run", action="store_true", help="do everything, but leave nothing behind")
    args = parser.parse_args(argv)
    try:
        if args.command == "prepare":
            release = Release(args.version, datetime.now(UTC).date())
            prepare(ROOT, release, dry_run=args.dry_run, say=_say)
        else:
            _build(ROOT, trial=args.command == "trial")
    except ReleaseError as error:
        print(f"release: {error}", file=sys.stderr)
        return 1
    return 0


def _build(root: Path, *, trial: bool) -> None:
    with tempfile.TemporaryDirectory() as place:
        (built_in := Path(place) / "dist").mkdir()
        built = distributions.build(root, built_in)
        distributions.check(built, root)
        if trial:
            print(try_wheel(built.wheel, root / "requirements.lock", Path(place)))
            return
        (root / "dist").mkdir(exist_ok=True)
        for file in (built.sdist, built.wheel):
            print(shutil.copy(file, root / "dist"))


def _say(line: str) -> None:
    # Flushed, so that it comes before what the next command prints.
    print(line, flush=True)


if __name__ == "__main__":
    sys.exit(main())
