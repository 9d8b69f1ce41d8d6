"""Selects the files of the checkout that are on the website, and their names.

The files in `docs/` are also read on a code host, with links as on disk. For the website they are copied to the paths
of their URLs, and their links are rewritten.
"""

import shutil
import tomllib
from collections.abc import Mapping
from pathlib import Path

from website.links import Places
from website.navigation import add_navigation

_ROOT_PAGES = ("README.md", "CONTRIBUTING.md", "SECURITY.md", "CHANGELOG.md")
_PICTURES = {".png", ".webp", ".svg"}


def names(root: Path) -> Mapping[Path, str]:
    """The pages, pictures and schemas of a checkout, each with its name on the site."""
    docs = root / "docs"
    found = {
        path: path.relative_to(docs).as_posix()
        for path in sorted(docs.rglob("*"))
        if path.suffix in {".md", ".json", *_PICTURES}
    }
    found |= {root / name: f"project/{name.lower()}" for name in _ROOT_PAGES}
    readmes = sorted((root / "integrations").glob("*/README.md"))
    return found | {path: f"project/integrations/{path.parent.name}.md" for path in readmes}


def write_pages(root: Path, target: Path) -> list[str]:
    """Write the pages in the form that Sphinx reads.

    Args:
        root: Root of the checkout.
        target: Folder to create.

    Returns:
        Names of the images, which Sphinx does not find because pages show them in HTML.

    Raises:
        LookupError: The target of a link does not exist, or the index does not list a page.
    """
    places = Places(root.resolve(), names(root.resolve()), _source_address(root))
    for path, name in places.names.items():
        file = target / name
        file.parent.mkdir(parents=True, exist_ok=True)
        if path.suffix == ".md":
            file.write_text(places.led(path), encoding="utf-8")
        else:
            shutil.copy(path, file)
    add_navigation(target, [name for name in places.names.values() if name.endswith(".md")])
    return [name for path, name in places.names.items() if path.suffix in _PICTURES]


def _source_address(root: Path) -> str | None:
    """URL of the source on a code host; None if it is not configured."""
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    address: str | None = project.get("urls", {}).get("Source")
    return None if address is None else address.rstrip("/")
