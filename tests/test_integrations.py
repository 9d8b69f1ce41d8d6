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


def test_variants_are_scenes_with_seeds_places_in_a_split_or_the_lines_of_a_file(tmp_path: Path) -> None:
    read = referee_client().read_variants
    pairs = [(variant["scene"], variant["seed"]) for variant in read("7,9-10", "1-2")]
    assert pairs == [(7, 1), (9, 1), (10, 1), (7, 2), (9, 2), (10, 2)]
    assert list(read("7")) == [{"scene": 7, "seed": 1}]
    assert list(read(split="train", indices="3-4")) == [{"split": "train", "index": 3}, {"split": "train", "index": 4}]
    assert list(read("7", split="train", random_seeds="5")) == [{"split": "train", "scene": 7, "random_seed": 5}]
    assert list(read("7", "10000", split="train")) == [{"split": "train", "scene": 7, "seed": 10000}]
    file = tmp_path / "pairs.jsonl"
    file.write_text('{"scene": 7, "seed": 3, "note": 1}\n{"split": "test", "index": 0}\n', encoding="utf-8")
    found = list(read(file=file))
    assert found == [{"scene": 7, "seed": 3}, {"split": "test", "index": 0}]
    assert list(map(referee_client().name_of, found)) == ["scene7-seed3", "test-index0"]


@pytest.mark.parametrize(
    ("given", "content", "says"),
    [
        ({}, None, "name scenes"),
        ({"split": "train"}, None, "name scenes"),
        ({"scenes": "7-"}, None, "scenes '7-': write whole numbers"),
        ({"scenes": "7", "seeds": "9-1"}, None, "seeds '9-1': write whole numbers"),
        ({"indices": "0-9"}, None, "name a split with indices"),
        ({"split": "train", "indices": "0", "random_seeds": "1"}, None, "name a split with indices"),
        ({}, '{"scene": 7, "seed": 3}\n{"scene": 7}\n', "line 2: write"),
        ({}, '{"split": "train"}\n', "line 1: write"),
        ({}, '{"split": "train", "index": "0"}\n', "line 1: write"),
        ({}, "[]\n", "line 1: write"),
    ],
)
def test_variants_that_cannot_be_read_are_refused_in_one_sentence(
    tmp_path: Path, given: dict[str, str], content: str | None, says: str
) -> None:
    file = tmp_path / "pairs.jsonl"
    file.write_text(content or "", encoding="utf-8")
    with pytest.raises(ValueError, match=re.escape(says)) as refused:
        list(referee_client().read_variants(**given, file=file if content else None))
    assert len(str(refused.value).splitlines()) == 1


def test_a_referee_that_cannot_be_reached_is_named_with_what_to_start() -> None:
    module = referee_client()
    for url, says in (("http://127.0.0.1:9", "start `physment-eval referee`"), ("here", "is not the URL of a referee")):
        with pytest.raises(module.RefereeError, match=says):
            module.Referee(url).open(7)
