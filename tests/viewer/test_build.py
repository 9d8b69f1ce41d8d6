"""The committed files are what the sources build, and the lock of node's packages names no host."""

from pathlib import Path

from tests.builders.paths import ROOT
from tests.builders.viewer import VIEWER, needs_node, run


@needs_node
def test_the_committed_files_are_what_the_sources_build(tmp_path: Path) -> None:
    run("node", "build.mjs", str(tmp_path))
    built = sorted(file.relative_to(tmp_path) for file in tmp_path.rglob("*") if file.is_file())
    assert built
    assert [name for name in built if (ROOT / name).read_bytes() != (tmp_path / name).read_bytes()] == []


@needs_node
def test_the_sources_fit_their_types() -> None:
    assert run(str(VIEWER / "node_modules" / ".bin" / "tsc")) == ""


def test_the_lock_names_no_host_and_every_package_has_a_hash() -> None:
    lock = (VIEWER / "package-lock.json").read_text(encoding="utf-8")
    assert "://" not in lock
    assert lock.count('"integrity": "sha512-') == lock.count('"node_modules/') > 20


def test_the_modules_of_the_viewer_are_small() -> None:
    files = [*(VIEWER / "src").glob("*.ts"), *(VIEWER / "test").glob("*.ts")]
    assert len(files) > 10
    assert [file.name for file in files if file.read_text(encoding="utf-8").count("\n") > 300] == []
