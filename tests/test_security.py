"""Tests of promises in SECURITY.md that no other test covers."""

import re
import shutil
from pathlib import Path

import pytest

from evaluator.commands.program import main as evaluate
from physment_mcp.commands.program import main as laboratory
from physment_mcp.scene import load_scene
from scenes import find_pack
from tests.builders.paths import ROOT


@pytest.fixture
def packs(tmp_path: Path) -> Path:
    """A folder with one pack whose `solution.py` creates a file `ran` there when it is executed."""
    folder = tmp_path / "packs"
    shutil.copytree(find_pack(7).folder, folder / "Scene7")
    with (folder / "Scene7" / "solution.py").open("a", encoding="utf-8") as solution:
        solution.write(f"\nopen({str(folder / 'ran')!r}, 'w').close()\n")
    return folder


def test_code_of_a_pack_does_not_run_where_only_its_data_is_needed(packs: Path, tmp_path: Path) -> None:
    load_scene(7, seed=3, folder=packs)
    assert laboratory(["export", str(tmp_path / "exported"), "--scenes-dir", str(packs)]) == 0
    assert laboratory(["bundle", str(tmp_path / "lab.mcpb"), "--scenes-dir", str(packs)]) == 0
    for command in (["list"], ["show", "7"]):
        assert evaluate(["scenes", *command, "--scenes-dir", str(packs)]) == 0
    assert not (packs / "ran").exists()


def test_any_run_computes_its_keys_with_the_code_of_a_pack(packs: Path, tmp_path: Path) -> None:
    """SECURITY.md warns of this behaviour; the test fails if the warning is out of date."""
    words = ["--agent", "blind", "--scenes", "7", "--seeds", "3", "--scenes-dir", str(packs)]
    evaluate([*words, "--out", str(tmp_path / "run"), "--max-time", "0.001"])
    assert (packs / "ran").exists()


def test_the_tests_that_hold_the_promises_exist() -> None:
    named = re.findall(r"`(tests/[\w/]+\.py)`", (ROOT / "SECURITY.md").read_text(encoding="utf-8"))
    assert len(named) > 10
    assert [name for name in named if not (ROOT / name).is_file()] == []


def test_lint_runs_the_code_of_a_pack(packs: Path) -> None:
    """SECURITY.md warns that this executes the code of a pack. The other tests use this pack to detect execution."""
    evaluate(["lint", "--scenes-dir", str(packs)])
    assert (packs / "ran").exists()
