"""Tests of the bundle for Claude Desktop: it matches its manifest, starts from any folder, and contains no answer."""

import ast
import json
import shutil
import struct
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path
from typing import Any

import anyio
import pytest
from mcp import Client, StdioServerParameters

import physment_mcp
from physment_mcp import __version__
from physment_mcp.commands.program import main
from scenes import find_pack, list_packs


@pytest.fixture(scope="module")
def packed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("bundle") / "dist" / "physment.mcpb"
    assert main(["bundle", str(file)]) == 0
    return file


@pytest.fixture(scope="module")
def unpacked(packed: Path) -> Path:
    folder = packed.parent / "installed here"
    with zipfile.ZipFile(packed) as bundle:
        bundle.extractall(folder)
    return folder


@pytest.fixture(scope="module")
def manifest(unpacked: Path) -> dict[str, Any]:
    return json.loads((unpacked / "manifest.json").read_text(encoding="utf-8"))


def test_the_manifest_promises_what_is_in_the_bundle(unpacked: Path, manifest: dict[str, Any]) -> None:
    assert manifest["version"] == __version__
    server = manifest["server"]
    assert (unpacked / server["entry_point"]).is_file()
    assert server["entry_point"] in server["mcp_config"]["args"]
    picture = (unpacked / manifest["icon"]).read_bytes()
    assert picture.startswith(b"\x89PNG\r\n")
    assert struct.unpack(">II", picture[16:24]) == (512, 512)
    assert len(manifest["tools"]) == 26
    last = manifest["user_config"]["seed"]["max"]
    for files in list_packs():
        assert (unpacked / "scenes" / f"Scene{files.scene_id}" / f"scene{files.scene_id}.seed{last}.xml").is_file()


async def test_an_unpacked_bundle_plays_a_scene(unpacked: Path, manifest: dict[str, Any], tmp_path: Path) -> None:
    """Starts the bundle as the application does, but with this interpreter instead of uv's."""
    words = [
        word.replace("${__dirname}", str(unpacked)).replace("${user_config.seed}", "20")
        for word in manifest["server"]["mcp_config"]["args"]
    ]
    place, entry, *options = words[words.index("--directory") + 1 :]
    server = StdioServerParameters(command=sys.executable, args=[str(Path(place) / entry), *options], cwd=tmp_path)
    with anyio.fail_after(120):
        async with Client(server) as client:
            assert [tool.name for tool in (await client.list_tools()).tools] == [
                tool["name"] for tool in manifest["tools"]
            ]
            prompt = await client.get_prompt("scene", {"scene_id": "7"})
            assert "# Scene: " in prompt.messages[0].content.text
            stepped = await client.call_tool("step", {"duration": 0.1})
            assert stepped.structured_content == {
                "sim_time": 0.1,
                "steps": 20,
                "lab_time_left": 3599.9,
                "calls_left": None,
                "results": None,
            }
            (contents,) = (await client.read_resource("physment://scenes")).contents
            assert len(json.loads(contents.text)["scenes"]) == len(list_packs())


def test_the_bundle_brings_the_dependencies_of_its_own_code(unpacked: Path) -> None:
    project = tomllib.loads((unpacked / "pyproject.toml").read_text(encoding="utf-8"))
    assert project["tool"]["uv"]["package"] is False
    named = [requirement for requirement in project["project"]["dependencies"] if requirement.startswith("mujoco")]
    assert named == ["mujoco==3.3.3"]  # the benchmark is defined on it
    brought = {
        requirement.split("=")[0].split("<")[0].split(">")[0] for requirement in project["project"]["dependencies"]
    }
    brought |= {"httpx2", "mcp_types", "pydantic_core", "starlette", "uvicorn"}  # brought by mcp and pydantic
    brought |= {"PIL"} & {"PIL" if name == "pillow" else name for name in brought}
    own = {"physment_mcp", "scenes"}
    imported: set[str] = set()
    for path in unpacked.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                imported |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                imported.add((node.module or "").split(".")[0])
    assert imported - own - set(sys.stdlib_module_names) - brought == set()


def test_the_bundle_holds_no_private_half(packed: Path, unpacked: Path) -> None:
    names = {path.name for path in (unpacked / "scenes").rglob("*.*") if path.parent.name.startswith("Scene")}
    assert names
    assert not [name for name in names if not (name.endswith(".public.json") or ".seed" in name)]
    assert not list(unpacked.rglob("solution.py"))
    with zipfile.ZipFile(packed) as bundle:
        names = {name for name in bundle.namelist() if not name.startswith("physment_mcp/")}
    assert {Path(name).suffix for name in names} == {".json", ".toml", ".py", ".png", ".xml"}


def test_every_file_of_the_package_is_in_the_bundle(unpacked: Path) -> None:
    """The bundle must also contain files that are not modules, such as the page of the chat app."""
    package = Path(str(physment_mcp.__file__)).parent
    files = {path.relative_to(package) for path in package.rglob("*") if path.is_file() and path.suffix != ".pyc"}
    bundled = unpacked / "physment_mcp"
    assert {path.relative_to(bundled) for path in bundled.rglob("*.*") if path.suffix != ".pyc"} == files
    assert Path("serving/lab.html") in files


def test_the_same_content_gives_the_same_file(tmp_path: Path) -> None:
    for scene in (7, 28):
        shutil.copytree(find_pack(scene).folder, tmp_path / "packs" / f"Scene{scene}")
    files = [tmp_path / "one.mcpb", tmp_path / "again.mcpb"]
    for file in files:
        assert main(["bundle", str(file), "--scenes-dir", str(tmp_path / "packs")]) == 0
    assert files[0].read_bytes() == files[1].read_bytes()


@pytest.mark.skipif(
    shutil.which("mcpb") is None, reason="the bundle's own tool is not installed: npm i -g @anthropic-ai/mcpb"
)
def test_the_tool_of_the_format_accepts_the_manifest(unpacked: Path) -> None:
    said = subprocess.run(["mcpb", "validate", str(unpacked)], capture_output=True, text=True, check=False, timeout=300)
    assert said.returncode == 0, said.stdout


def test_the_name_of_a_bundle_must_end_in_mcpb(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["bundle", str(tmp_path / "physment.zip")]) == 2
    assert "end in .mcpb" in capsys.readouterr().err
