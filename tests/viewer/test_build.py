"""Tests that the committed bundles equal a new build of the sources, and that the lock of node's packages names no
host.
"""

import re
from pathlib import Path

from physment_mcp.tools import TOOLS
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


def test_every_tool_and_argument_has_plain_words() -> None:
    text = (VIEWER / "src" / "plain.ts").read_text(encoding="utf-8")
    tools, arguments = (
        set(re.findall(r"^  (\w+): ", text.partition(f"const {name}: ")[2].partition("};")[0], re.MULTILINE))
        for name in ("TOOLS", "ARGUMENTS")
    )
    assert tools == {*(tool.name for tool in TOOLS), "answer"}
    taken = {argument for tool in TOOLS for argument in tool.arguments.model_fields}
    # These arguments are shown under their own names.
    assert taken - arguments <= {"name", "joint", "axis", "answer", "steps"}
    assert arguments <= taken
