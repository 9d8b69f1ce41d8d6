"""Prepares a release in a worktree of its own: version, changelog, checks, files, then commit and tag. Pushes nothing.

The checkout changes at the very end, when everything has passed; until then a failure or an interruption leaves it as
it was.
"""

import shutil
import tempfile
from collections.abc import Callable, Generator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import date
from pathlib import Path

from release import distributions, versions
from release.process import ReleaseError, output, show

CHECKS = (("make", "check"), ("make", "test"), ("make", "test-wheel"))
"""What must pass in the worktree, where the first of them installs the locked dependencies anew."""


@dataclass(frozen=True, slots=True)
class Release:
    """A release that is to be prepared."""

    version: str
    day: date
    """Date in the changelog and in CITATION.cff."""

    @property
    def tag(self) -> str:
        """Name of its git tag."""
        return f"v{self.version}"


def prepare(
    root: Path,
    release: Release,
    *,
    dry_run: bool,
    checks: Sequence[Sequence[str]] = CHECKS,
    say: Callable[[str], object],
) -> None:
    """Prepare a release; see the module's docstring.

    Args:
        root: The checkout.
        release: Version and date.
        dry_run: Do everything, but leave no commit, tag or file behind.
        checks: Commands that must pass in the worktree.
        say: Takes a line for each step.

    Raises:
        ReleaseError: The tree is not clean, the version is not newer, or a step failed. The checkout is unchanged.
    """
    refuse_unless_ready(root, release)
    with _worktree(root) as tree, tempfile.TemporaryDirectory() as built_in:
        versions.write(tree, release.version, release.day)
        say(f"wrote {release.version} into {', '.join((*versions.PLACES, versions.CHANGELOG))}")
        for check in checks:
            say(f"running {' '.join(check)}")
            show(*check, cwd=tree)
        built = distributions.build(tree, Path(built_in))
        distributions.check(built, tree)
        say(f"built and checked {built.sdist.name} and {built.wheel.name}")
        if dry_run:
            say(f"dry run: no commit, no tag {release.tag}, nothing in dist/; the checkout is as it was")
            return
        output("git", "commit", "--all", "--message", f"Release {release.version}", cwd=tree)
        commit = output("git", "rev-parse", "HEAD", cwd=tree).strip()
        output("git", "merge", "--ff-only", commit, cwd=root)
        output("git", "tag", "--annotate", release.tag, "--message", f"Release {release.version}", commit, cwd=root)
        say(f"committed {commit[:7]} and tagged it {release.tag}")
        (root / "dist").mkdir(exist_ok=True)
        for file in (built.sdist, built.wheel):
            shutil.copy(file, root / "dist")
        say(f"pushed nothing. To publish: git push --follow-tags, and upload the files of {release.version} in dist/")


def refuse_unless_ready(root: Path, release: Release) -> None:
    """Refuse a tree with changes, a version that is not newer, and a tag that exists.

    Raises:
        ReleaseError: One of them holds.
    """
    versions.check_newer(root, release.version)
    if changed := output("git", "status", "--porcelain", cwd=root):
        raise ReleaseError(f"commit or remove these changes first:\n{changed}".rstrip())
    if output("git", "tag", "--list", release.tag, cwd=root):
        raise ReleaseError(f"the tag {release.tag} exists already")


@contextmanager
def _worktree(root: Path) -> Generator[Path]:
    """A second worktree of the present commit, removed at the end; it shares the checkout's commits and settings."""
    with tempfile.TemporaryDirectory() as place:
        tree = Path(place) / "tree"
        output("git", "worktree", "add", "--detach", str(tree), cwd=root)
        try:
            yield tree
        finally:
            output("git", "worktree", "remove", "--force", str(tree), cwd=root)
