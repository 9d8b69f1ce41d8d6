"""`server.json`, the entry of a release in the MCP registry: where the laboratory is, and how a client starts it.

Source: the registry's schema `server.schema.json` of 2025-12-11, and its rules for packages: a package of the Python
index is taken only if its README names the server, a bundle only with its hash and from a release page.
"""

import hashlib
import json
import re
import tomllib
from pathlib import Path
from typing import Any

from release.process import ReleaseError

SCHEMA = "https://static.modelcontextprotocol.io/schemas/2025-12-11/server.schema.json"
_GITHUB = re.compile(r"https://github\.com/(?P<owner>[\w-]+)/(?P<name>[\w.-]+?)/?(?:\.git)?")
_DESCRIPTION = "A physics laboratory in MuJoCo: find quantities by experiment, with 26 typed tools."
"""At most 100 characters, as the registry demands."""
_SEED = {
    "type": "named",
    "name": "--seed",
    "description": "Variant of the scenes: 0 as written, another number for other hidden values.",
    "format": "number",
    "default": "0",
}


def write_server_json(root: Path, bundle: Path, target: Path, source: str | None = None) -> list[str]:
    """Write the file.

    Args:
        root: The checkout.
        bundle: The bundle for Claude Desktop, as it will be on the release page.
        target: File to write.
        source: Address of the repository on GitHub; by default the one in `pyproject.toml`.

    Returns:
        The registries in which the file says the laboratory is.

    Raises:
        ReleaseError: There is no address of a repository on GitHub, or no bundle.
    """
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    address = source or project.get("urls", {}).get("Source")
    if address is None or (place := _GITHUB.fullmatch(address)) is None:
        raise ReleaseError(
            "server.json needs the address of the repository on GitHub, from which the registry takes the server's"
            " name: set Source in [project.urls] of pyproject.toml, or give --source"
        )
    if not bundle.is_file():
        raise ReleaseError(f"{bundle} does not exist; `make mcpb` writes it")
    record = server(project, place["owner"], address.rstrip("/"), bundle.read_bytes())
    if f"mcp-name: {record['name']}\n" not in (root / "README.md").read_text(encoding="utf-8"):
        record["packages"] = [package for package in record["packages"] if package["registryType"] != "pypi"]
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(json.dumps(record, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    return [package["registryType"] for package in record["packages"]]


def server(project: dict[str, Any], owner: str, address: str, bundle: bytes) -> dict[str, Any]:
    """The entry of a release, with all its packages.

    Args:
        project: The table `project` of `pyproject.toml`.
        owner: Who owns the repository on GitHub; the registry lets nobody else use names that begin with it.
        address: Of the repository.
        bundle: Content of the bundle.
    """
    version: str = project["version"]
    stdio = {"type": "stdio"}
    return {
        "$schema": SCHEMA,
        "name": f"io.github.{owner}/{project['name']}",
        "title": "PhysMent laboratory",
        "description": _DESCRIPTION,
        "version": version,
        "repository": {"url": address, "source": "github"},
        "packages": [
            {
                "registryType": "pypi",
                "identifier": project["name"],
                "version": version,
                "runtimeHint": "uvx",
                "transport": stdio,
                "packageArguments": [_SEED],
            },
            {
                "registryType": "mcpb",
                "identifier": f"{address}/releases/download/v{version}/physment.mcpb",
                "version": version,
                "fileSha256": hashlib.sha256(bundle).hexdigest(),
                "transport": stdio,
            },
        ],
    }
