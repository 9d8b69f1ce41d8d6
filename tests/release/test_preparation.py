"""A release: what it refuses, what it leaves behind, and that it changes nothing before everything has passed."""

import subprocess
import zipfile
from datetime import date
from pathlib import Path

import pytest

from release.distributions import Distributions, build, check
from release.preparation import Release, prepare, refuse_unless_ready
from release.process import ReleaseError
from release.versions import PLACES, written
from tests.builders.paths import ROOT

DAY = date(2030, 1, 2)
CHANGELOG = """# Changelog

## Unreleased

- Something new.

## 0.1.0 (2029-12-01)

- The first release.
"""


def git(*words: str, cwd: Path) -> str:
    done = subprocess.run(("git", *words), cwd=cwd, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def name_committer(repository: Path) -> None:
    git("config", "user.name", "A tester", cwd=repository)
    git("config", "user.email", "tester@example.invalid", cwd=repository)


def commit_changelog(repository: Path, text: str) -> None:
    (repository / "CHANGELOG.md").write_text(text, encoding="utf-8")
    git("add", "--all", cwd=repository)
    git("commit", "--message", "Start", cwd=repository)


@pytest.fixture
def project(tmp_path: Path) -> Path:
    """A repository with the files that hold the version, after a release of 0.1.0; it cannot be built."""
    repository = tmp_path / "project"
    for place in PLACES:
        (repository / place).parent.mkdir(parents=True, exist_ok=True)
        text = (ROOT / place).read_text(encoding="utf-8").replace(f'"{written(ROOT)}"', '"0.1.0"')
        (repository / place).write_text(text, encoding="utf-8")
    git("init", "--initial-branch", "main", cwd=repository)
    name_committer(repository)
    commit_changelog(repository, CHANGELOG)
    return repository


def state(repository: Path) -> tuple[str, str, str, str]:
    """Everything of a repository that a release may change: commit, tags, worktrees, files."""
    return (
        git("rev-parse", "HEAD", cwd=repository),
        git("tag", cwd=repository),
        git("worktree", "list", "--porcelain", cwd=repository),
        git("status", "--porcelain", "--ignored", cwd=repository),
    )


def test_a_newer_version_in_a_clean_tree_is_accepted(project: Path) -> None:
    refuse_unless_ready(project, Release("0.1.1", DAY))


@pytest.mark.parametrize(
    ("version", "sentence"),
    [
        ("0.1.0", "not newer than 0.1.0"),
        ("0.0.9", "not newer than 0.1.0"),
        ("0.2", "not a version of the form X.Y.Z"),
        ("v0.2.0", "not a version of the form X.Y.Z"),
        ("0.2.0rc1", "not a version of the form X.Y.Z"),
        ("0.02.0", "not a version of the form X.Y.Z"),
    ],
)
def test_a_version_that_is_not_newer_is_refused(project: Path, version: str, sentence: str) -> None:
    with pytest.raises(ReleaseError, match=sentence):
        refuse_unless_ready(project, Release(version, DAY))


def test_versions_are_compared_as_numbers(project: Path) -> None:
    commit_changelog(project, CHANGELOG.replace("## 0.1.0", "## 0.10.0"))
    with pytest.raises(ReleaseError, match=r"0\.9\.0 is not newer than 0\.10\.0"):
        refuse_unless_ready(project, Release("0.9.0", DAY))


def test_the_first_release_may_have_the_version_of_the_tree_but_none_below(project: Path) -> None:
    commit_changelog(project, "# Changelog\n\n## Unreleased\n\n- All of it.\n")
    refuse_unless_ready(project, Release("0.1.0", DAY))
    with pytest.raises(ReleaseError, match=r"older than 0\.1\.0, the version of this tree"):
        refuse_unless_ready(project, Release("0.0.9", DAY))


@pytest.mark.parametrize("name", ["CITATION.cff", "new.txt"])
def test_a_tree_with_a_changed_or_new_file_is_refused(project: Path, name: str) -> None:
    with (project / name).open("a", encoding="utf-8") as file:
        file.write("\n")
    with pytest.raises(ReleaseError, match=name):
        refuse_unless_ready(project, Release("0.2.0", DAY))


def test_a_tag_that_exists_is_refused(project: Path) -> None:
    git("tag", "v0.2.0", cwd=project)
    with pytest.raises(ReleaseError, match=r"v0\.2\.0 exists"):
        refuse_unless_ready(project, Release("0.2.0", DAY))


def test_versions_that_differ_are_refused(project: Path) -> None:
    citation = project / "CITATION.cff"
    citation.write_text(citation.read_text(encoding="utf-8").replace("0.1.0", "0.1.5"), encoding="utf-8")
    git("commit", "--all", "--message", "Forget two places", cwd=project)
    with pytest.raises(ReleaseError, match=r"differ: pyproject\.toml 0\.1\.0, .*CITATION\.cff 0\.1\.5"):
        refuse_unless_ready(project, Release("0.2.0", DAY))


@pytest.mark.parametrize(
    ("changelog", "checks", "sentence"),
    [
        (CHANGELOG.replace("- Something new.\n", ""), [], "nothing under"),
        (CHANGELOG, [("git", "diff", "--quiet")], "`git diff --quiet` failed"),
        (CHANGELOG, [], "build"),
    ],
    ids=["nothing to release", "a check fails", "the build fails"],
)
def test_a_step_that_fails_leaves_the_checkout_as_it_was(
    project: Path, changelog: str, checks: list[tuple[str, ...]], sentence: str
) -> None:
    """The check that fails here, `git diff --quiet`, also shows that checks see the new version."""
    if changelog != CHANGELOG:
        commit_changelog(project, changelog)
    before = state(project)
    with pytest.raises(ReleaseError, match=sentence):
        prepare(project, Release("0.2.0", DAY), dry_run=False, checks=checks, say=lambda _: None)
    assert state(project) == before


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """This project as it was last committed, with something to release."""
    if not (ROOT / ".git").exists():
        pytest.skip("this is no git checkout, so there is nothing to clone")
    repository = tmp_path_factory.mktemp("clone") / "project"
    git("clone", "--quiet", str(ROOT), str(repository), cwd=ROOT)
    name_committer(repository)
    commit_changelog(repository, CHANGELOG)
    return repository


def test_a_release_is_tried_and_then_made(clone: Path) -> None:
    """One test, since each step builds the whole project."""
    major, minor, patch = map(int, written(clone).split("."))
    version = f"{major}.{minor}.{patch + 1}"
    before, branch = state(clone), git("branch", "--show-current", cwd=clone)
    lines: list[str] = []

    prepare(clone, Release(version, DAY), dry_run=True, checks=[], say=lines.append)
    assert state(clone) == before
    assert f"physment_mcp-{version}-py3-none-any.whl" in lines[-2]
    assert f"no tag v{version}" in lines[-1]

    prepare(clone, Release(version, DAY), dry_run=False, checks=[("git", "diff", "--check")], say=lines.append)
    assert git("rev-parse", "HEAD^", cwd=clone) == before[0]
    assert git("log", "-1", "--format=%s", cwd=clone) == f"Release {version}"
    assert git("rev-parse", f"v{version}^{{commit}}", cwd=clone) == git("rev-parse", "HEAD", cwd=clone)
    assert git("branch", "--show-current", cwd=clone) == branch
    assert git("status", "--porcelain", cwd=clone) == ""
    assert len(git("worktree", "list", cwd=clone).splitlines()) == 1
    assert sorted(file.name for file in (clone / "dist").iterdir()) == [
        f"physment_mcp-{version}-py3-none-any.whl",
        f"physment_mcp-{version}.tar.gz",
    ]

    assert written(clone) == version
    assert f'version: "{version}"\ndate-released: "2030-01-02"\n' in (clone / "CITATION.cff").read_text(
        encoding="utf-8"
    )
    changelog = (clone / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"## Unreleased\n\n## {version} (2030-01-02)\n\n- Something new.\n\n## 0.1.0" in changelog
    with pytest.raises(ReleaseError, match="not newer"):
        refuse_unless_ready(clone, Release(version, DAY))


def test_each_file_of_sdist_and_wheel_is_compared_with_those_that_git_tracks(clone: Path, tmp_path: Path) -> None:
    built = build(clone, tmp_path / "dist")
    check(built, clone)
    wheel = tmp_path / "other.whl"
    with zipfile.ZipFile(built.wheel) as whole, zipfile.ZipFile(wheel, "w") as other:
        for name in set(whole.namelist()) - {"scenes/Scene7/scene7.xml"}:
            other.writestr(name, "")
        other.writestr("tests/conftest.py", "")
    with pytest.raises(
        ReleaseError,
        match=r"other\.whl .*\n  missing: scenes/Scene7/scene7\.xml\n  not tracked: tests/conftest\.py$",
    ):
        check(Distributions(built.sdist, wheel), clone)
    (clone / "added.txt").touch()
    git("add", "added.txt", cwd=clone)
    git("rm", "--cached", "--quiet", "Makefile", cwd=clone)
    try:
        with pytest.raises(ReleaseError, match=r"tar\.gz .*\n  missing: added\.txt\n  not tracked: Makefile$"):
            check(built, clone)
    finally:
        git("reset", "--hard", "--quiet", cwd=clone)
