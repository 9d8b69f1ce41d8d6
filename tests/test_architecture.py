"""The dependency rules, the size of modules and the names of tools, held by one walk over the source."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.builders.paths import ROOT

PACKAGES = ("physment_mcp", "evaluator", "scenes")

FORBIDDEN = {
    "physment_mcp": {"evaluator", "scenes.protocol", "solution"},
    "physment_mcp/world": {"mcp", "mcp_types", "pydantic", "scenes", "physment_mcp.session", "physment_mcp.scene"},
    "physment_mcp/tools": {"mujoco", "mcp", "mcp_types", "scenes"},
    "physment_mcp/session.py": {"mujoco", "mcp", "mcp_types", "pathlib", "json"},
    "physment_mcp/mechanics.py": {"mujoco", "physment_mcp"},
    "evaluator": {"physment_mcp", "mujoco"},
    "evaluator/episode/loop.py": {
        "evaluator.answers.keys",
        "evaluator.answers.grading",
        "evaluator.scores.scoring",
        "scenes",
    },
    "evaluator/study/runner.py": {"evaluator.answers.keys", "evaluator.answers.grading", "evaluator.scores.scoring"},
    "evaluator/agents": {"evaluator.answers.keys", "evaluator.answers.grading", "evaluator.scores.scoring"},
    "evaluator/answers/grading.py": {"mcp", "pathlib", "os", "json"},
    "evaluator/scores/metrics.py": {"mcp", "pathlib", "os"},
    "evaluator/scores/grounding.py": {"mcp", "pathlib", "os"},
    "evaluator/failures": {"mcp", "pathlib", "os", "evaluator.answers.keys", "evaluator.store"},
    "scenes": {"mcp", "mcp_types", "mujoco", "physment_mcp", "evaluator"},
}
"""Part of the tree → modules nothing in it may import."""

EXEMPT = {"evaluator": ("evaluator/certify",), "scenes": ("scenes/Scene",)}
"""Rule → parts of the tree it does not speak of: the room that may know both sides, and packs, which are data."""

ONLY_THERE = {
    "mujoco": ("physment_mcp/world",),
    "inspect_ai": ("evaluator/inspect_task.py",),
    "pydantic_ai": ("evaluator/models", "evaluator/models/agent.py"),
    "matplotlib": ("evaluator/report/figures.py",),
    "ray": ("evaluator/study/ray_executor.py",),
}
"""Module → the only parts of the tree that may import it."""

MODULE_LINES, FUNCTION_LINES = 340, 60


def modules() -> list[Path]:
    return sorted(
        path.relative_to(ROOT)
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
        if not re.search(r"scenes/Scene\d+/", path.as_posix())
    )


def imports(source: str) -> Iterator[str]:
    """Everything a module imports, anywhere in it, with dots."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module or ""
            yield from (f"{node.module}.{name.name}" for name in node.names)


def under(path: str, part: str) -> bool:
    return path == part or path.startswith(f"{part}/")


def violations(path: str, source: str) -> list[str]:
    """The dependency rules that a module at `path` breaks."""
    imported = set(imports(source))
    found = [
        f"{path} imports {module}"
        for part, banned in FORBIDDEN.items()
        if under(path, part) and not path.startswith(EXEMPT.get(part, ("-",)))
        for module in sorted(imported)
        if any(module == one or module.startswith(f"{one}.") for one in banned)
    ]
    for module, rooms in ONLY_THERE.items():
        if not any(under(path, room) for room in rooms) and not path.startswith("evaluator/certify"):
            found += [
                f"{path} imports {one}" for one in sorted(imported) if one == module or one.startswith(f"{module}.")
            ]
    return found


@pytest.mark.parametrize("path", modules(), ids=str)
def test_a_module_imports_nothing_it_must_not_know(path: Path) -> None:
    assert violations(path.as_posix(), (ROOT / path).read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("evaluator/episode/loop.py", "from evaluator.answers.keys import KeyRing"),
        ("evaluator/report/page.py", "def f():\n    import mujoco"),
        ("evaluator/study/runner.py", "import physment_mcp.session"),
        ("physment_mcp/tools/act.py", "from mujoco import MjModel"),
        ("physment_mcp/serving/server.py", "import evaluator"),
        ("physment_mcp/scene.py", "from scenes.protocol import load_solution"),
        ("physment_mcp/serving/server.py", "import mujoco"),
        ("physment_mcp/world/world.py", "from mcp import Client"),
        ("scenes/draw.py", "from physment_mcp import errors"),
    ],
)
def test_a_planted_import_is_caught(path: str, source: str) -> None:
    assert violations(path, source)


def test_the_laboratory_never_names_a_private_field_of_a_pack() -> None:
    private = re.compile(r"pack\.(answer\b|reasoning|expected_behavior|knobs|derive|apply|canary|requires)|\.accept\b")
    named = [
        str(path)
        for path in modules()
        if path.parts[0] == "physment_mcp" and private.search((ROOT / path).read_text(encoding="utf-8"))
    ]
    assert named == []


@pytest.mark.parametrize("package", PACKAGES)
def test_the_modules_of_a_package_form_no_import_cycle(package: str) -> None:
    names = {_module_name(path): path for path in modules() if path.parts[0] == package}
    graph = {
        name: {one for one in imports((ROOT / path).read_text(encoding="utf-8")) if one in names and one != name}
        for name, path in names.items()
        if path.name != "__init__.py"
    }
    done: set[str] = set()

    def visit(name: str, trail: tuple[str, ...]) -> None:
        assert name not in trail, " → ".join((*trail, name))
        if name not in done:
            for other in sorted(graph.get(name, ())):
                visit(other, (*trail, name))
            done.add(name)

    for name in graph:
        visit(name, ())


def _module_name(path: Path) -> str:
    parts = path.with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def test_modules_and_functions_fit_one_head() -> None:
    long: list[str] = []
    for path in modules():
        source = (ROOT / path).read_text(encoding="utf-8")
        lines = len(source.splitlines())
        if lines > MODULE_LINES:
            long.append(f"{path} has {lines} lines")
        for node in ast.walk(ast.parse(source)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                length = (node.end_lineno or 0) - node.lineno + 1
                if length > FUNCTION_LINES:
                    long.append(f"{path}: {node.name} has {length} lines")
    assert long == []


def test_every_module_says_what_it_is_and_none_is_a_drawer() -> None:
    for path in modules():
        assert path.stem not in {"utils", "util", "helpers", "common", "misc"}, path
        assert ast.get_docstring(ast.parse((ROOT / path).read_text(encoding="utf-8"))), path


def test_the_evaluator_imports_without_the_engine() -> None:
    code = "import sys, evaluator.__main__; sys.exit('mujoco' in sys.modules or 'physment_mcp' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
