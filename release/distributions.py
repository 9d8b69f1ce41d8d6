"""Builds the sdist and the wheel, and checks which files are in them."""

import sys
import tarfile
import zipfile
from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

from release.process import ReleaseError, output

PACKAGES = ("evaluator", "physment_mcp", "scenes")


@dataclass(frozen=True, slots=True)
class Distributions:
    """What is uploaded."""

    sdist: Path
    wheel: Path
    """Built from the sdist, so an sdist that lacks a file cannot stay unnoticed."""


def build(root: Path, target: Path) -> Distributions:
    """Build the sdist from a checkout and the wheel from that sdist.

    Args:
        root: The checkout.
        target: A new or empty folder for both files.

    Raises:
        ReleaseError: The build failed.
    """
    output(sys.executable, "-m", "build", "--no-isolation", "--outdir", str(target), str(root), cwd=root)
    (sdist,), (wheel,) = target.glob("*.tar.gz"), target.glob("*.whl")
    return Distributions(sdist, wheel)


def check(built: Distributions, root: Path) -> None:
    """Hold the content against the files that git tracks.

    The sdist must hold every tracked file, the wheel every tracked file of the three packages (the scene packs,
    templates and `py.typed` are among them); neither may hold anything else but its metadata.

    Raises:
        ReleaseError: A file is missing or does not belong there.
    """
    tracked = set(output("git", "ls-files", "-z", cwd=root).split("\0")) - {""}
    with tarfile.open(built.sdist) as sdist:
        names = {name.partition("/")[2] for name in sdist.getnames()}
    _compare(built.sdist, names - {"PKG-INFO"}, tracked)
    with zipfile.ZipFile(built.wheel) as wheel:
        names = {name for name in wheel.namelist() if ".dist-info/" not in name}
    _compare(built.wheel, names, {name for name in tracked if name.startswith(tuple(f"{one}/" for one in PACKAGES))})


def _compare(file: Path, found: Collection[str], expected: Collection[str]) -> None:
    missing, extra = sorted(set(expected) - set(found)), sorted(set(found) - set(expected))
    if missing or extra:
        raise ReleaseError(
            "\n".join(
                [
                    f"{file.name} does not hold the files that git tracks:",
                    *(f"  missing: {name}" for name in missing),
                    *(f"  not tracked: {name}" for name in extra),
                ]
            )
        )
