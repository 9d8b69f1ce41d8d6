"""Tests of the files that users install: the lock file, and the wheel outside the checkout."""

import re
import subprocess
import sys
import sysconfig
import tomllib
import venv
import zipfile
from pathlib import Path

import pytest
from packaging.requirements import Requirement

import scenes
from physment_mcp import __version__
from tests.builders.paths import ROOT


def run(*command: str, cwd: Path) -> str:
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False, timeout=300)
    assert done.returncode == 0, f"{command}: {done.stdout}\n{done.stderr}"
    return done.stdout


def built(source: Path, place: Path) -> Path:
    """The wheel of a package, in a folder that has no other."""
    run(sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(place), str(source), cwd=place)
    (wheel,) = place.glob("*.whl")
    return wheel


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bin folder of a new environment with our wheel and the dependencies installed here."""
    place = tmp_path_factory.mktemp("wheel")
    wheel = built(ROOT, place)
    environment = place / "env"
    venv.create(environment, with_pip=True)
    binaries = environment / "bin"
    run(str(binaries / "python"), "-m", "pip", "install", "--quiet", "--no-deps", str(wheel), cwd=place)
    site = next((environment / "lib").glob("python*")) / "site-packages"
    # Python ignores .pth files in a folder added by a .pth file, so editable installs there have no effect.
    dependencies = place / "dependencies"
    dependencies.mkdir()
    for found in Path(sysconfig.get_path("purelib")).iterdir():
        if not found.name.startswith(("physment_", "_editable", "__editable__")):  # our own are not installed there yet
            (dependencies / found.name).symlink_to(found)
    (site / "dependencies.pth").write_text(f"{dependencies}\n", encoding="utf-8")
    return binaries


def test_the_wheel_contains_every_file_of_every_pack(installed: Path, tmp_path: Path) -> None:
    code = (
        "import scenes; packs = scenes.list_packs();"
        "assert all(f.json.is_file() and f.mjcf.is_file() and f.solution.is_file() for f in packs);"
        "assert scenes.content_hash_of('125dc8c43267').startswith('c1:');"
        "print(scenes.__file__); print(*(f.scene_id for f in packs))"
    )
    where, ids = run(str(installed / "python"), "-c", code, cwd=tmp_path).splitlines()
    assert Path(where).is_relative_to(installed.parent)
    assert ids.split() == [str(files.scene_id) for files in scenes.list_packs()]


def test_the_wheel_holds_every_file_of_the_packages_that_git_tracks_and_no_other(installed: Path) -> None:
    (wheel,) = installed.parents[1].glob("*.whl")
    with zipfile.ZipFile(wheel) as opened:
        held = {name for name in opened.namelist() if ".dist-info/" not in name}
    tracked = subprocess.run(
        ["git", "ls-files", "-z", "evaluator", "physment_mcp", "scenes"], cwd=ROOT, capture_output=True, check=False
    )
    if tracked.returncode:
        pytest.skip("this is no checkout of git")
    assert held == set(tracked.stdout.decode().split("\0")) - {""}


def test_the_wheel_has_the_version_of_the_code(installed: Path) -> None:
    (wheel,) = installed.parents[1].glob("*.whl")
    assert wheel.name == f"physment_mcp-{__version__}-py3-none-any.whl"


def test_the_packages_in_the_wheel_are_marked_as_typed(installed: Path, tmp_path: Path) -> None:
    code = (
        "from importlib.resources import files;"
        "print(*(name for name in ('physment_mcp', 'evaluator', 'scenes') if (files(name) / 'py.typed').is_file()))"
    )
    assert run(str(installed / "python"), "-c", code, cwd=tmp_path).split() == ["physment_mcp", "evaluator", "scenes"]


def test_the_wheel_plays_a_scene_outside_the_checkout(installed: Path, tmp_path: Path) -> None:
    assert "--scene" in run(str(installed / "physment-mcp"), "--help", cwd=tmp_path)
    said = run(str(installed / "physment-eval"), "--server", "stdio", "--scenes", "7", "--out", "run", cwd=tmp_path)
    assert "(1/1)" in said
    assert (tmp_path / "run" / "report.html").stat().st_size > 1000


def test_the_command_harbor_comes_with_its_plugin(installed: Path, tmp_path: Path) -> None:
    command = [str(installed / "physment-eval"), "harbor", "write", "tasks", "--scenes", "7"]
    without = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300)
    assert (without.returncode, without.stderr.splitlines()) == (
        2,
        [
            "physment-eval: harbor needs the plugin physment-harbor, which is not installed: in a checkout, pip install"
            " ./integrations/harbor"
        ],
    )
    wheel = built(ROOT / "integrations" / "harbor", tmp_path)
    run(str(installed / "python"), "-m", "pip", "install", "--quiet", "--no-deps", str(wheel), cwd=tmp_path)
    assert run(*command, cwd=tmp_path) == "1 tasks are written in tasks\n"
    programs = {path.name for path in (tmp_path / "tasks").rglob("*") if path.suffix in {".py", ".sh"}}
    assert programs == {"start.sh", "collect.py", "solve.sh", "play.py", "test.sh"}


@pytest.mark.parametrize("name", ["requirements.lock", "requirements-docs.lock"])
def test_every_requirement_in_a_lock_has_a_hash_and_none_names_a_host(name: str) -> None:
    lock = (ROOT / name).read_text(encoding="utf-8")
    assert not re.search(r"https?:|--(extra-)?index-url|--find-links|file:", lock)
    requirements = re.split(r"\n(?=[A-Za-z0-9])", lock.split("\n", 1)[1])
    assert len(requirements) > 30
    assert [text.split()[0] for text in requirements if "--hash=sha256:" not in text] == []


@pytest.mark.parametrize(("name", "group"), [("requirements.lock", "dev"), ("requirements-docs.lock", "docs")])
def test_a_lock_satisfies_every_requirement_of_the_project(name: str, group: str) -> None:
    lock = (ROOT / name).read_text(encoding="utf-8")
    locked: dict[str, list[str]] = {}
    for package, pinned in re.findall(r"^([a-z0-9-]+)==([^ ;]+)", lock, flags=re.MULTILINE):
        locked.setdefault(package, []).append(pinned)
    pyproject = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    own = pyproject["project"]["dependencies"] if group == "dev" else []
    for text in [*own, *pyproject["dependency-groups"][group]]:
        required = Requirement(text)
        assert all(pinned in required.specifier for pinned in locked[required.name]), text
