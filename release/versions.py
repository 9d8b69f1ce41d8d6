"""Where the version is written, and the changelog's sections. Knows no git and builds nothing."""

import re
from datetime import date
from pathlib import Path

from release.process import ReleaseError

Version = tuple[int, int, int]

CHANGELOG = "CHANGELOG.md"
PLACES = {
    "pyproject.toml": re.compile(r'^(version = ")(.+)(")$', re.MULTILINE),
    "physment_mcp/version.py": re.compile(r'^(__version__ = ")(.+)(")$', re.MULTILINE),
    "CITATION.cff": re.compile(r'^(version: ")(.+)(")$', re.MULTILINE),
}
"""File → the one line in it that holds the version."""

_UNRELEASED = "## Unreleased\n"
_RELEASED = re.compile(r"^## (\d+\.\d+\.\d+) \(\d{4}-\d\d-\d\d\)$", re.MULTILINE)
_RELEASE_DATE = re.compile(r"^date-released: .*\n", re.MULTILINE)


def parse(text: str) -> Version:
    """A version as three numbers, which compare as versions do.

    Raises:
        ReleaseError: It is not of the form X.Y.Z.
    """
    match = re.fullmatch(r"(0|[1-9]\d*)\.(0|[1-9]\d*)\.(0|[1-9]\d*)", text)
    if match is None:
        raise ReleaseError(f"{text!r} is not a version of the form X.Y.Z, such as 0.2.0")
    return int(match[1]), int(match[2]), int(match[3])


def written(root: Path) -> str:
    """The version that all places agree on.

    Raises:
        ReleaseError: A place holds no version, or they differ.
    """
    found: dict[str, str] = {}
    for place, line in PLACES.items():
        matches = line.findall((root / place).read_text(encoding="utf-8"))
        if len(matches) != 1:
            raise ReleaseError(f"{place} must hold the version on exactly one line; it does on {len(matches)}")
        found[place] = matches[0][1]
    if len(set(found.values())) != 1:
        raise ReleaseError(f"the versions differ: {', '.join(f'{place} {text}' for place, text in found.items())}")
    return found["pyproject.toml"]


def check_newer(root: Path, version: str) -> None:
    """Refuse a version that was released, or that is older than what is written.

    The version that is written now may be released once: that is how the first release is made.

    Raises:
        ReleaseError: It is not newer.
    """
    last = max(map(parse, _RELEASED.findall(_changelog(root))), default=None)
    if last is not None and parse(version) <= last:
        raise ReleaseError(f"{version} is not newer than {'.'.join(map(str, last))}, the last release in {CHANGELOG}")
    if parse(version) < parse(written(root)):
        raise ReleaseError(f"{version} is older than {written(root)}, the version of this tree")


def write(root: Path, version: str, day: date) -> None:
    """Write the version everywhere, and turn the changelog's Unreleased section into the section of this version.

    Raises:
        ReleaseError: The changelog has nothing unreleased.
    """
    changelog = _changelog(root)
    if not unreleased(changelog):
        raise ReleaseError(f"{CHANGELOG} has nothing under “## Unreleased”: say what changes for users")
    heading = f"{_UNRELEASED}\n## {version} ({day.isoformat()})\n"
    (root / CHANGELOG).write_text(changelog.replace(_UNRELEASED, heading, 1), encoding="utf-8")
    for place, line in PLACES.items():
        file = root / place
        file.write_text(line.sub(rf"\g<1>{version}\g<3>", file.read_text(encoding="utf-8")), encoding="utf-8")
    citation = root / "CITATION.cff"
    text = _RELEASE_DATE.sub("", citation.read_text(encoding="utf-8"))
    dated = f'version: "{version}"\ndate-released: "{day.isoformat()}"\n'
    citation.write_text(text.replace(f'version: "{version}"\n', dated), encoding="utf-8")


def notes(root: Path, version: str) -> str:
    """What the changelog says of a version.

    Raises:
        ReleaseError: It has no section of this version.
    """
    _, found, rest = _changelog(root).partition(f"\n## {version} (")
    if not found:
        raise ReleaseError(f"{CHANGELOG} has no section of {version}; `make release` makes it")
    return rest.partition("\n")[2].split("\n## ", 1)[0].strip() + "\n"


def unreleased(changelog: str) -> str:
    """What the changelog says of changes that no release has yet; empty if nothing."""
    _, found, rest = changelog.partition(_UNRELEASED)
    return rest.split("\n## ", 1)[0].strip() if found else ""


def _changelog(root: Path) -> str:
    return (root / CHANGELOG).read_text(encoding="utf-8")
