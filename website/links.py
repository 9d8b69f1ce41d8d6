"""The links of a page, led from where files lie in the checkout to where they are on the website."""

import os
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

_FENCED = re.compile(r"^(?P<fence>```+).*?^(?P=fence)$", re.DOTALL | re.MULTILINE)
_LINK = re.compile(r"`[^`]+`|\[(?P<text>(?:`[^`]*`|[^\[\]`])*)\]\((?P<target>[^)\s]+)\)")
"""A link, or code between backquotes, in which nothing is a link."""
_SOURCE = re.compile(r'(?P<before>\b(?:src|srcset)=")(?P<target>[^"]+)"')
_HEADING = re.compile(r"^#+ (.+)$", re.MULTILINE)


@dataclass(frozen=True, slots=True)
class Places:
    """Where the files of a checkout are on the website."""

    root: Path
    """The checkout."""
    names: Mapping[Path, str]
    """File → name on the site, for every file that is on it."""
    source: str | None
    """Address at which the source can be read, if there is one."""

    def led(self, page: Path) -> str:
        """The text of a page with its links led to the site.

        A link to what is not on the site, such as a module, leads to the source; without an address its words stay.

        Raises:
            LookupError: A link leads to nothing, or to a picture that is not on the site.
        """

        def link(found: re.Match[str]) -> str:
            target = found["target"]
            return found[0] if target is None or re.match(r"\w+:", target) else self._link(page, found["text"], target)

        def picture(found: re.Match[str]) -> str:
            return f'{found["before"]}{self._path(page, self._file(page, found["target"], shown=True))}"'

        text = page.read_text(encoding="utf-8")
        return outside_code(text, lambda part: _SOURCE.sub(picture, _LINK.sub(link, part)))

    def _link(self, page: Path, text: str, target: str) -> str:
        path, _, anchor = target.partition("#")
        file = self._file(page, path) if path else page
        if file not in self.names:
            kind = "tree" if file.is_dir() else "blob"
            return f"[{text}]({self.source}/{kind}/main/{file.relative_to(self.root)})" if self.source else text
        led, place = self._path(page, file) if path else "", f"#{anchor}" if anchor else ""
        if anchor and anchor not in _headings(file):
            # A place that is marked in HTML. The generator does not know it, so the link is HTML too.
            return f'<a href="{re.sub(r"[.]md$", ".html", led)}{place}">{text}</a>'
        return f"[{text}]({led}{place})"

    def _file(self, page: Path, path: str, *, shown: bool = False) -> Path:
        file = (page.parent / path).resolve()
        if not file.exists() or (shown and file not in self.names):
            raise LookupError(f"{page.relative_to(self.root)}: {path} is missing")
        return file

    def _path(self, page: Path, file: Path) -> str:
        return Path(os.path.relpath(self.names[file], Path(self.names[page]).parent)).as_posix()


def outside_code(text: str, change: Callable[[str], str]) -> str:
    """A text in Markdown, changed everywhere but in fenced blocks."""
    done, start = "", 0
    for block in _FENCED.finditer(text):
        done += change(text[start : block.start()]) + block[0]
        start = block.end()
    return done + change(text[start:])


def _headings(page: Path) -> set[str]:
    """The anchors of the headings of a page, as code hosts make them."""
    text = _FENCED.sub("", page.read_text(encoding="utf-8"))
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in _HEADING.findall(text)}
