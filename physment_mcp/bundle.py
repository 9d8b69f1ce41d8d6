"""The laboratory as a bundle for Claude Desktop (`.mcpb`): a zip file that the application installs with one click.

It contains the code of this package, a manifest, and exported scenes, so that no answers are on the machine where the
model works. The application installs Python and the dependencies with `uv`, so one file serves every operating system.

Source: the MCP Bundle manifest, version 0.4.
"""

import json
import re
import tempfile
import zipfile
from collections.abc import Collection, Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

import scenes
from physment_mcp.serving.resources import LARGE_PNG
from physment_mcp.tools import TOOLS
from physment_mcp.version import __version__
from scenes import export_packs

_NEEDED = ("anyio", "mcp", "mujoco", "numpy", "pillow", "pydantic")
"""The dependencies that an episode on stdio needs; the others are for hosts and evaluators."""
_STARTER = '''\
"""Starts the laboratory on stdio."""

from physment_mcp.__main__ import entry

entry()
'''
_MAIN = "main.py"
_EPOCH = (1980, 1, 1, 0, 0, 0)
"""Date of every file in the bundle. It is fixed so that equal content gives a byte-identical bundle."""


def write_bundle(target: Path, seeds: Collection[int], scenes_dir: Path | None = None) -> None:
    """Write the bundle.

    Args:
        target: File to write; an existing one is replaced.
        seeds: Variants of each scene to include.
        scenes_dir: Folder of whole packs; the suite by default.

    Raises:
        PackError: A pack is malformed.
        OSError: The file cannot be written.
    """
    with tempfile.TemporaryDirectory() as place:
        packs = Path(place) / "packs"
        export_packs(packs, seeds, source=scenes_dir)
        files = {
            "manifest.json": json.dumps(manifest(max(seeds)), indent=2, ensure_ascii=False).encode(),
            "icon.png": LARGE_PNG,
            "pyproject.toml": _project().encode(),
            _MAIN: _STARTER.encode(),
            **dict(_code()),
            **{f"scenes/{path.relative_to(packs).as_posix()}": path.read_bytes() for path in packs.rglob("*.*")},
        }
    target.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as bundle:
        for name, content in sorted(files.items()):
            entry = zipfile.ZipInfo(name, _EPOCH)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.external_attr = 0o644 << 16
            bundle.writestr(entry, content)


def manifest(last_seed: int) -> dict[str, Any]:
    """Return the manifest: what the application shows, and how it starts the laboratory.

    Args:
        last_seed: The greatest seed that a person may choose.
    """
    return {
        "manifest_version": "0.4",
        "name": "physment-mcp",
        "display_name": "PhysMent laboratory",
        "version": __version__,
        "description": "A physics laboratory: find quantities by experiment in MuJoCo scenes.",
        "long_description": "Choose the prompt `scene` and a number. The model is told a task, experiments with 26"
        " tools (push, wait, measure, create, reveal, attach), and answers once. The right answers are not in here.",
        "author": {"name": "PhysMent MCP contributors"},
        "license": "MIT",
        "icon": "icon.png",
        "keywords": ["physics", "mujoco", "simulation", "benchmark"],
        "server": {
            "type": "uv",
            "entry_point": _MAIN,
            "mcp_config": {
                "command": "uv",
                "args": ["run", "--directory", "${__dirname}", _MAIN, "--seed", "${user_config.seed}"],
            },
        },
        "tools": [{"name": tool.name, "description": tool.description} for tool in TOOLS],
        "prompts_generated": True,
        "compatibility": {
            "platforms": ["darwin", "win32", "linux"],
            "runtimes": {"python": _python()},
        },
        "user_config": {
            "seed": {
                "type": "number",
                "title": "Variant",
                "description": "0 for the scenes as written; another number for other hidden values.",
                "default": 0,
                "min": 0,
                "max": last_seed,
                "required": False,
            }
        },
    }


def _code() -> Iterator[tuple[str, bytes]]:
    """Return the files of this package and those modules of `scenes` that it needs, by name in the bundle."""
    root = Path(__file__).parent
    for path in root.rglob("*"):
        if path.is_file() and path.parent.name != "__pycache__":
            yield f"physment_mcp/{path.relative_to(root).as_posix()}", path.read_bytes()
    folder = Path(scenes.__file__).parent
    for name in sorted(_modules_of_scenes(root, folder)):
        yield f"scenes/{name}.py", (folder / f"{name}.py").read_bytes()


def _modules_of_scenes(root: Path, folder: Path) -> set[str]:
    """Return the modules of `scenes` that the laboratory imports.

    The others are left out, because the modules for reference protocols need further libraries.
    """
    found, unread = set[str](), [folder / "__init__.py", *root.rglob("*.py")]
    while unread:
        named = set(
            re.findall(r"^\s*from scenes\.(\w+) import", unread.pop().read_text(encoding="utf-8"), re.MULTILINE)
        )
        unread += [folder / f"{name}.py" for name in named - found]
        found |= named
    return found | {"__init__"}


def _project() -> str:
    """Return the pyproject.toml from which `uv` installs the dependencies."""
    declared = metadata.requires("physment-mcp") or []
    needed = [line for line in declared if _name(line) in _NEEDED and "extra" not in line]
    assert {_name(line) for line in needed} == set(_NEEDED)
    return "\n".join(
        [
            "[project]",
            'name = "physment-mcp-bundle"',
            f'version = "{__version__}"',
            f'requires-python = "{_python()}"',
            f"dependencies = {json.dumps(sorted(needed))}",
            "",
            "[tool.uv]",
            "package = false",
            "",
        ]
    )


def _name(requirement: str) -> str:
    match = re.match(r"[\w.-]+", requirement)
    assert match is not None
    return match[0].lower()


def _python() -> str:
    return metadata.metadata("physment-mcp")["Requires-Python"]
