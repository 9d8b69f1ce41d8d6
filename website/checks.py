"""Checks of the built site: internal links must resolve, and no page may load resources from other sites."""

import re
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

_LOADS = {
    ("script", "src"),
    ("img", "src"),
    ("iframe", "src"),
    ("source", "srcset"),
    ("object", "data"),
    ("video", "src"),
}
"""Elements and attributes whose targets browsers load automatically; for `link` it depends on `rel`."""
_HARMLESS = {"canonical", "next", "prev", "index", "search", "author", "license"}
"""Values of `rel` of a `link` whose target is not loaded."""
_STYLE = re.compile(r"(?:@import\s+|url\()\s*[\"']?((?:https?:)?//[^\"')\s]+)")


class _Page(HTMLParser):
    """Parser that collects the anchors of a page, its links and the resources that it loads."""

    def __init__(self) -> None:
        super().__init__()
        self.places: set[str] = set()
        self.links: list[str] = []
        self.loads: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Record the anchor, link or resource of an element."""
        named = {name: value or "" for name, value in attrs}
        self.places |= {named[name] for name in ("id", "name") if name in named}
        if tag == "a" and "href" in named:
            self.links.append(named["href"])
        if tag == "link" and not set(named.get("rel", "").split()) & _HARMLESS:
            self.loads.append(named.get("href", ""))
        self.loads += [named[attribute] for element, attribute in _LOADS if element == tag and attribute in named]


def faults(site: Path) -> list[str]:
    """Check a site; returns a sentence for each fault.

    Args:
        site: Folder of the built pages.
    """
    pages: dict[Path, _Page] = {}
    for file in sorted(site.rglob("*.html")):
        pages[file] = _Page()
        pages[file].feed(file.read_text(encoding="utf-8"))
    found = [fault for file, page in pages.items() for fault in _page_faults(file, page, pages, site)]
    for file in sorted(site.rglob("*.css")):
        addresses = _STYLE.findall(file.read_text(encoding="utf-8"))
        found += [f"{file.relative_to(site)} loads {address}" for address in addresses]
    return found


def _page_faults(file: Path, page: _Page, pages: dict[Path, _Page], site: Path) -> Iterator[str]:
    name = file.relative_to(site).as_posix()
    for target in page.loads:
        address = urlsplit(target)
        if address.netloc:
            yield f"{name} loads {target}"
        elif address.scheme != "data" and address.path and not (file.parent / unquote(address.path)).is_file():
            yield f"{name} shows {target}, which is missing"
    for target in page.links:
        address = urlsplit(target)
        if address.netloc or address.scheme:
            continue
        led = (file.parent / unquote(address.path)).resolve() if address.path else file
        if not led.is_file():
            yield f"{name} links {target}, which is missing"
        elif address.fragment and led in pages and unquote(address.fragment) not in pages[led].places:
            yield f"{name} links {target}, and there is no such place"
