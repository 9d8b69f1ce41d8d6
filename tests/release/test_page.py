"""What the page of a release offers besides the wheel: the entry in the MCP registry, and the notes."""

import hashlib
import json
import re
from pathlib import Path

import pytest

from physment_mcp.commands.program import parser
from release.process import ReleaseError
from release.server_json import write_server_json
from release.versions import notes
from tests.builders.paths import ROOT

SOURCE = "https://github.com/some-lab/physment"


@pytest.fixture
def bundle(tmp_path: Path) -> Path:
    file = tmp_path / "physment.mcpb"
    file.write_bytes(b"a bundle")
    return file


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    """A folder with what decides the entry."""
    folder = tmp_path / "checkout"
    folder.mkdir()
    for name in ("pyproject.toml", "README.md"):
        (folder / name).write_text((ROOT / name).read_text(encoding="utf-8"), encoding="utf-8")
    return folder


def test_the_entry_keeps_the_rules_of_the_registry(checkout: Path, bundle: Path, tmp_path: Path) -> None:
    """Those of its schema that concern us, and those that it checks itself."""
    with (checkout / "README.md").open("a", encoding="utf-8") as readme:
        readme.write("<!--\nmcp-name: io.github.some-lab/physment-mcp\n-->\n")
    assert write_server_json(checkout, bundle, tmp_path / "server.json", SOURCE) == ["pypi", "mcpb"]
    entry = json.loads((tmp_path / "server.json").read_text(encoding="utf-8"))
    assert re.fullmatch(r"[a-zA-Z0-9.-]+/[a-zA-Z0-9._-]+", entry["name"])
    assert 1 <= len(entry["description"]) <= 100
    assert 1 <= len(entry["title"]) <= 100
    assert entry["repository"] == {"url": SOURCE, "source": "github"}
    for package in entry["packages"]:
        assert package["version"] == entry["version"]
        assert package["transport"] == {"type": "stdio"}
    index, file = entry["packages"]
    assert index["identifier"] == "physment-mcp"
    words = [word for one in index["packageArguments"] for word in (one["name"], one["default"])]
    assert parser().parse_args(words).run
    assert file["identifier"] == f"{SOURCE}/releases/download/v{entry['version']}/physment.mcpb"
    assert file["fileSha256"] == hashlib.sha256(b"a bundle").hexdigest()


def test_an_index_that_the_registry_would_refuse_is_left_out(checkout: Path, bundle: Path, tmp_path: Path) -> None:
    """The README of the package must name the server, and nobody has given it a name yet."""
    assert write_server_json(checkout, bundle, tmp_path / "server.json", f"{SOURCE}/") == ["mcpb"]


@pytest.mark.parametrize("source", [None, "https://example.org/physment", "github.com/some-lab"])
def test_without_an_address_on_github_there_is_no_entry(
    checkout: Path, bundle: Path, tmp_path: Path, source: str | None
) -> None:
    with pytest.raises(ReleaseError, match="needs the address of the repository on GitHub"):
        write_server_json(checkout, bundle, tmp_path / "server.json", source)
    assert not (tmp_path / "server.json").exists()


def test_without_a_bundle_there_is_no_entry(checkout: Path, tmp_path: Path) -> None:
    with pytest.raises(ReleaseError, match="`make mcpb` writes it"):
        write_server_json(checkout, tmp_path / "absent.mcpb", tmp_path / "server.json", SOURCE)


def test_the_notes_are_the_section_of_the_version(tmp_path: Path) -> None:
    sections = ("# Changelog", "## Unreleased", "- Later.", "## 0.2.0 (2030-01-02)", "- New.", "## 0.1.0 (2029-01-01)")
    (tmp_path / "CHANGELOG.md").write_text("\n\n".join([*sections, "- Old.\n"]), encoding="utf-8")
    assert notes(tmp_path, "0.2.0") == "- New.\n"
    assert notes(tmp_path, "0.1.0") == "- Old.\n"
    with pytest.raises(ReleaseError, match=r"no section of 0\.3\.0"):
        notes(tmp_path, "0.3.0")
