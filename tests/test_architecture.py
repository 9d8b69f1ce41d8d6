"""Checks every import against the architecture page, and the sizes and names of modules."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.builders.paths import DOCS, ROOT

PACKAGES = ("physment_mcp", "evaluator", "scenes")
MODULE_LINES, FUNCTION_LINES = 340, 60
EVALUATOR_LAYERS = 8

NEVER = {
    "physment_mcp": {"evaluator", "scenes.protocol", "solution"},
    "evaluator": {"physment_mcp", "mujoco"},
    "scenes": {"mcp", "mcp_types", "mujoco", "physment_mcp", "evaluator"},
}
"""Package → modules that nothing in it may import."""

PRIVILEGED = ("evaluator/certify", "evaluator/answers/engine.py")
"""Parts of the evaluator that may know the server's code and the engine."""

ONLY_THERE = {
    "mujoco": ("physment_mcp/world", "evaluator/certify"),
    "inspect_ai": (),
    "opentelemetry": ("evaluator/episode/tracing.py", "evaluator/commands/playing.py"),
    "pyarrow": ("evaluator/report/parquet.py",),
    "pydantic_ai": ("evaluator/agents/models",),
    "matplotlib": ("evaluator/report/figures.py",),
    "ray": ("evaluator/study/ray_executor.py",),
    "evaluator.answers.engine": ("evaluator/answers/keys.py", "evaluator/certify", "evaluator/commands/scenes.py"),
}
"""Library or module → the only parts of the tree that may import it."""

CONTRACT = "physment_mcp.contract"
"""The part of the laboratory that all packages may import; it imports no other package of the project."""

MODULE_RULES = {
    "evaluator/study/runner.py": {"evaluator.answers", "evaluator.scores"},
    "evaluator/answers/grading.py": {"pathlib", "os", "json"},
    "evaluator/scores/metrics.py": {"pathlib"},
    "evaluator/scores/grounding.py": {"pathlib"},
    "evaluator/scores/failures": {"pathlib", "os", "evaluator.answers.keys", "evaluator.store"},
    "evaluator/episode/protocols": {"mcp", "pathlib"},
}
"""Rules for parts of a component: module or folder → what it may not import."""


@dataclass(frozen=True)
class Component:
    """A row of the tables in the architecture page."""

    layer: int
    purpose: str
    forbidden: frozenset[str]


def components_of(page: str) -> dict[str, dict[str, Component]]:
    """Map each package to its components, and each component to its row in a table of the architecture page."""
    found: dict[str, dict[str, Component]] = {}
    for section in re.split(r"^### ", page, flags=re.MULTILINE)[1:]:
        package = re.match(r"`(\w+)`", section)
        assert package, section[:40]
        rows = re.findall(r"^\| (\d+) \| `([\w/]+)` \| (.+?) \| ?(.*?) ?\|$", section, flags=re.MULTILINE)
        found[package[1]] = {
            name.rstrip("/"): Component(int(layer), purpose, frozenset(re.findall(r"`([\w.]+)`", forbidden)))
            for layer, name, purpose, forbidden in rows
        }
    return found


COMPONENTS = components_of((DOCS / "explanation" / "architecture.md").read_text(encoding="utf-8"))


def modules() -> list[Path]:
    return sorted(
        path.relative_to(ROOT)
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
        if not re.search(r"scenes/(Scene\d+|templates)/", path.as_posix())
    )


def imports(source: str) -> Iterator[str]:
    """Return the dotted names that a module imports, anywhere in it."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield node.module or ""
            yield from (f"{node.module}.{name.name}" for name in node.names)


def under(path: str, part: str) -> bool:
    return path == part or path.startswith(f"{part}/")


def under_module(name: str, module: str) -> bool:
    return name == module or name.startswith(f"{module}.")


def component_of(module: str) -> str | None:
    """Return the component of a dotted name such as `evaluator.answers.keys`; None for a package's `__init__`."""
    package, _, rest = module.partition(".")
    name = rest.split(".")[0]
    return name if name in COMPONENTS.get(package, {}) else None


def violations(path: str, source: str) -> list[str]:
    """Return the rules that the imports of the module at `path` break."""
    imported = sorted(set(imports(source)))
    package, component = path.split("/", maxsplit=1)[0], component_of(dotted(Path(path)))
    forbidden: set[str] = set() if path.startswith(PRIVILEGED) else set(NEVER[package])
    if package != "physment_mcp":
        imported = [module for module in imported if not under_module(module, CONTRACT)]
    forbidden |= {one for part, rule in MODULE_RULES.items() if under(path, part) for one in rule}
    forbidden |= {one for one, allowed in ONLY_THERE.items() if not any(under(path, part) for part in allowed)}
    if component:
        forbidden |= COMPONENTS[package][component].forbidden
    found = [f"{path} imports {module}" for module in imported if any(under_module(module, one) for one in forbidden)]
    if component:
        layers = {name: row.layer for name, row in COMPONENTS[package].items()}
        found += [
            f"{path} in layer {layers[component]} imports {module} in layer {layers[other]}"
            for module in imported
            if module.startswith(f"{package}.") and (other := component_of(module)) and other != component
            if layers[other] >= layers[component]
        ]
    return found


def dotted(path: Path) -> str:
    parts = path.with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports_between(sources: Mapping[str, str], folder: str) -> dict[str, set[str]]:
    """Return the imports between the files and subfolders of a folder: name → names that it imports.

    Args:
        sources: Dotted name of a module → its source.
        folder: Dotted name of the folder.
    """
    depth = folder.count(".") + 2

    def child(module: str) -> str:
        return ".".join(module.split(".")[:depth])

    inside = {module: source for module, source in sources.items() if module.startswith(f"{folder}.")}
    graph: dict[str, set[str]] = {child(module): set() for module in inside}
    for module, source in inside.items():
        targets = {child(name) for name in imports(source) if name.startswith(f"{folder}.")}
        graph[child(module)] |= (targets & set(graph)) - {child(module)}
    return graph


def circle_in(graph: Mapping[str, set[str]]) -> tuple[str, ...]:
    """Return a cycle of imports, with its first name repeated at the end; empty if there is none."""
    done: set[str] = set()

    def visit(name: str, trail: tuple[str, ...]) -> tuple[str, ...]:
        if name in trail:
            return (*trail[trail.index(name) :], name)
        if name not in done:
            for other in sorted(graph[name]):
                if found := visit(other, (*trail, name)):
                    return found
            done.add(name)
        return ()

    return next((found for name in sorted(graph) if (found := visit(name, ()))), ())


def all_sources() -> dict[str, str]:
    return {dotted(path): (ROOT / path).read_text(encoding="utf-8") for path in modules()}


FOLDERS = sorted({dotted(path.parent / "__init__.py") for path in modules()})


@pytest.mark.parametrize("path", modules(), ids=str)
def test_a_module_imports_only_what_its_room_allows(path: Path) -> None:
    assert violations(path.as_posix(), (ROOT / path).read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("evaluator/episode/loop.py", "from evaluator.answers.keys import KeyRing"),
        ("evaluator/episode/loop.py", "from evaluator.agents import reference"),
        ("evaluator/report/page.py", "def f():\n    import mujoco"),
        ("evaluator/report/page.py", "from evaluator.commands.terminal import print_results"),
        ("evaluator/scores/failures/findings.py", "from evaluator.answers.keys import KeyRing"),
        ("evaluator/scores/metrics.py", "from evaluator.agents.models.choice import Choice"),
        ("evaluator/study/runner.py", "import physment_mcp.session"),
        ("evaluator/study/runner.py", "from evaluator.scores import scoring"),
        ("evaluator/answers/keys.py", "from physment_mcp.session import Session"),
        ("evaluator/agents/human.py", "import pydantic_ai"),
        ("physment_mcp/tools/act.py", "from mujoco import MjModel"),
        ("physment_mcp/serving/server.py", "import evaluator"),
        ("physment_mcp/scene.py", "from scenes.protocol import load_solution"),
        ("physment_mcp/session.py", "from physment_mcp.tools.results import Result"),
        ("physment_mcp/serving/server.py", "import mujoco"),
        ("physment_mcp/world/world.py", "from mcp import Client"),
        ("scenes/draw.py", "from physment_mcp import errors"),
        ("scenes/pack.py", "from scenes.folder import PackFiles"),
    ],
)
def test_a_planted_import_is_caught(path: str, source: str) -> None:
    assert violations(path, source)


@pytest.mark.parametrize("folder", FOLDERS)
def test_neither_files_nor_folders_import_each_other_in_a_circle(folder: str) -> None:
    circle = circle_in(imports_between(all_sources(), folder))
    assert not circle, " → ".join(circle)


def test_a_planted_circle_between_two_folders_is_caught() -> None:
    sources = {
        "house.cellar.wine": "from house.attic.chest import Key",
        "house.attic.roof": "from house.cellar.stairs import Step",
        "house.attic.chest": "",
        "house.cellar.stairs": "",
    }
    assert circle_in(imports_between(sources, "house")) == ("house.attic", "house.cellar", "house.attic")
    assert not circle_in(imports_between(sources, "house.cellar"))


@pytest.mark.parametrize("package", PACKAGES)
def test_the_architecture_page_lists_every_component_of_a_package_and_no_other(package: str) -> None:
    found = {
        path.parts[1].removesuffix(".py")
        for path in modules()
        if path.parts[0] == package and path.parts[1] != "__init__.py"
    }
    assert set(COMPONENTS[package]) == found
    assert all(component.purpose.endswith(".") for component in COMPONENTS[package].values())


def test_the_evaluator_has_no_more_than_eight_floors() -> None:
    assert max(component.layer for component in COMPONENTS["evaluator"].values()) <= EVALUATOR_LAYERS


@pytest.mark.parametrize("package", PACKAGES)
def test_a_room_lies_directly_above_the_highest_room_that_it_imports(package: str) -> None:
    graph = imports_between(all_sources(), package)
    layers = {f"{package}.{name}": component.layer for name, component in COMPONENTS[package].items()}
    lowest = {name: 1 + max((layers[other] for other in below), default=0) for name, below in graph.items()}
    assert {name: layers[name] for name in graph} == lowest


def test_nothing_inside_a_package_imports_the_package_itself() -> None:
    facades = [
        f"{path} imports {package}"
        for path in modules()
        for package in PACKAGES
        if path.parts[0] == package and path.parts[1] != "__init__.py"
        for node in ast.walk(ast.parse((ROOT / path).read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and node.module == package
        if not all(f"{package}.{name.name}" in set(map(dotted, modules())) for name in node.names)
    ]
    assert facades == []


def test_the_laboratory_never_names_a_private_field_of_a_pack() -> None:
    private = re.compile(r"pack\.(answer\b|reasoning|expected_behavior|knobs|derive|apply|canary|requires)|\.accept\b")
    named = [
        str(path)
        for path in modules()
        if path.parts[0] == "physment_mcp" and private.search((ROOT / path).read_text(encoding="utf-8"))
    ]
    assert named == []


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


def test_every_module_has_a_docstring_and_a_telling_name() -> None:
    for path in modules():
        assert path.stem not in {"utils", "util", "helpers", "common", "misc"}, path
        assert ast.get_docstring(ast.parse((ROOT / path).read_text(encoding="utf-8"))), path


def test_the_evaluator_imports_without_the_engine() -> None:
    code = "import sys; from evaluator.commands.program import parsed; parsed(['run']);"
    code += "print(*sys.modules)"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    ours = {name for name in loaded if name.startswith("physment_mcp.") and not under_module(name, CONTRACT)}
    assert "evaluator.commands.run" in loaded
    assert ("mujoco" in loaded, ours) == (False, {"physment_mcp.version"})


def test_no_command_imports_another_command() -> None:
    """Code that two commands share belongs in a module that declares no command, such as `playing` or `finishing`."""
    found = {
        path.stem: set(imports((ROOT / path).read_text(encoding="utf-8")))
        for path in modules()
        if path.parts[:2] in {("evaluator", "commands"), ("physment_mcp", "commands")}
    }
    declared = {
        f"evaluator.commands.{path.stem}"
        for path in (ROOT / "evaluator" / "commands").glob("*.py")
        if re.search(r"^def add\(commands", path.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert "evaluator.commands.run" in declared
    assert {name: used & declared for name, used in found.items() if used & declared} == {}
