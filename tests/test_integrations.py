"""What must hold of `integrations/` without any framework: what the packages import, and the client that they share."""

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.builders.paths import ROOT
from tests.builders.referee_client import referee_client

FOLDER = ROOT / "integrations"
PACKAGES = sorted(path.parent for path in FOLDER.glob("*/pyproject.toml"))
OURS = {"physment_mcp", "evaluator", "scenes", "mujoco"}
"""What no integration may import: it has requirements of its own, and must hold no key."""


def imported(folder: Path) -> Iterator[tuple[str, str]]:
    """Each module of a package with the packages that it imports."""
    for path in sorted(folder.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [name.name for name in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            yield from ((path.relative_to(FOLDER).as_posix(), name.partition(".")[0]) for name in names)


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.name)
def test_an_integration_imports_neither_the_laboratory_nor_the_evaluator(package: Path) -> None:
    assert [found for found in imported(package) if found[1] in OURS] == []


@pytest.mark.parametrize("package", PACKAGES, ids=lambda package: package.name)
def test_an_integration_has_requirements_of_its_own_and_none_of_ours(package: Path) -> None:
    project = tomllib.loads((package / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    required = project.get("dependencies", [])
    assert [one for one in required if one.startswith(("physment-mcp", "mujoco"))] == []
    assert ("physment-referee-client" in required) == (package.name != "client")


def test_the_shared_client_needs_the_standard_library_alone() -> None:
    assert {name for _, name in imported(FOLDER / "client")} <= sys.stdlib_module_names


def test_pairs_are_every_scene_with_every_seed_or_the_lines_of_a_file(tmp_path: Path) -> None:
    read_pairs = referee_client().read_pairs
    assert list(read_pairs("7,9-10", "1-2")) == [(7, 1), (9, 1), (10, 1), (7, 2), (9, 2), (10, 2)]
    file = tmp_path / "pairs.jsonl"
    file.write_text('{"scene": 7, "seed": 3}\n{"scene": 8, "seed": 0, "split": "train"}\n', encoding="utf-8")
    assert list(read_pairs(file=file)) == [(7, 3), (8, 0)]


@pytest.mark.parametrize(
    ("scenes", "seeds", "content", "says"),
    [
        ("", "1", None, "name scenes"),
        ("7-", "1", None, "scenes '7-': write whole numbers"),
        ("7", "9-1", None, "seeds '9-1': write whole numbers"),
        ("", "", '{"scene": 7, "seed": 3}\n{"scene": 7}\n', "line 2: write"),
    ],
)
def test_pairs_that_cannot_be_read_are_refused_in_one_sentence(
    tmp_path: Path, scenes: str, seeds: str, content: str | None, says: str
) -> None:
    file = tmp_path / "pairs.jsonl"
    file.write_text(content or "", encoding="utf-8")
    with pytest.raises(ValueError, match=re.escape(says)) as refused:
        list(referee_client().read_pairs(scenes, seeds, file if content else None))
    assert len(str(refused.value).splitlines()) == 1


def test_a_referee_that_cannot_be_reached_is_named_with_what_to_start() -> None:
    module = referee_client()
    for url, says in (("http://127.0.0.1:9", "start `physment-eval referee`"), ("here", "is not the URL of a referee")):
        with pytest.raises(module.RefereeError, match=says):
            module.Referee(url).open(7)
