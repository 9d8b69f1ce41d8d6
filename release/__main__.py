"""Command line of the release: `python -m release build`, `trial`, `prepare` or `page`; the Makefile calls it."""

import argparse
import shutil
import sys
import tempfile
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from release import distributions, versions
from release.preparation import Release, prepare
from release.process import ReleaseError
from release.server_json import write_server_json
from release.trial import try_one_liners, try_wheel

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
    page = commands.add_parser("page", help="write server.json and the notes for the page of a release, into dist/")
    page.add_argument("--source", help="address of the repository on GitHub (default: Source in pyproject.toml)")
    page.add_argument("--tag", help="refuse if this is not the tag of the version that is written")
    args = parser.parse_args(argv)
    try:
        if args.command == "page":
            _write_page(ROOT, args.source, args.tag)
        elif args.command == "prepare":
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
            print(try_one_liners(built.wheel, Path(place)))
            return
        (root / "dist").mkdir(exist_ok=True)
        for file in (built.sdist, built.wheel):
            print(shutil.copy(file, root / "dist"))


def _write_page(root: Path, source: str | None, tag: str | None) -> None:
    version = versions.written(root)
    if tag not in {None, f"v{version}"}:
        raise ReleaseError(f"the tag is {tag}, but the version that is written is {version}")
    notes = versions.notes(root, version)
    registries = write_server_json(root, root / "dist" / "physment.mcpb", root / "dist" / "server.json", source)
    (root / "dist" / "notes.md").write_text(notes, encoding="utf-8")
    print(f"dist/server.json names {', '.join(registries)}; dist/notes.md says what is new in {version}")
    if "pypi" not in registries:
        print("not the Python index, whose package must say `mcp-name: …` in README.md for the registry to take it")


def _say(line: str) -> None:
    # Flushed, so that it comes before what the next command prints.
    print(line, flush=True)


if __name__ == "__main__":
    sys.exit(main())
