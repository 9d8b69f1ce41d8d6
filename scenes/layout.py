"""The formatter of the JSON and XML files of packs: width 110, indent 2.

It changes only white space between tokens. Numbers, strings and attributes keep their spelling and order. Elements
without children are closed in their own tag, and blank lines are removed. `ruff format` formats `solution.py`.
"""

import json
import re
import shutil
import tempfile
import xml.etree.ElementTree as ET
from collections import deque
from collections.abc import Iterator, Sequence
from pathlib import Path

from scenes.content import pack_hash
from scenes.errors import PackError
from scenes.folder import PackFiles

WIDTH = 110
"""Largest number of characters of a line, unless a single text or attribute is longer."""
_INDENT = "  "

_JSON_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|[\[\]{}:,]|[^\s\[\]{}:,"]+')
_XML_TOKEN = re.compile(r"""<!--.*?-->|<\?.*?\?>|<!\[CDATA\[.*?\]\]>|<(?:[^>"']|"[^"]*"|'[^']*')*>|[^<]+""", re.DOTALL)
_XML_TAG = re.compile(r"<(?P<name>[^\s/>]+)(?P<attributes>.*?)(?P<end>/?>)", re.DOTALL)
_XML_ATTRIBUTE = re.compile(r"""([^\s=]+)\s*=\s*("[^"]*"|'[^']*')""")

_Items = list[tuple[str, "_Node"]]
_Node = str | tuple[str, _Items, str]
"""A JSON value: a token; or an opening bracket, the inner values with their prefixes (`"name": ` or nothing), and a
closing bracket."""


def lay_out(files: PackFiles) -> list[Path]:
    """Format the JSON and the XML of a pack: both, or neither if one of them cannot be formatted.

    Returns:
        The files that were changed.

    Raises:
        PackError: A file is missing or cannot be parsed or written, or the content would change.
    """
    texts = _laid_out(files)
    if not texts:
        return []
    try:
        with tempfile.TemporaryDirectory(prefix=".layout-", dir=files.folder) as place:
            fresh = PackFiles(files.scene_id, Path(place))
            for file in (files.json, files.mjcf, files.solution):
                if file.is_file():
                    shutil.copy(file, fresh.folder)
            for file, text in texts.items():
                (fresh.folder / file.name).write_text(text, encoding="utf-8", newline="\n")
            if pack_hash(fresh) != pack_hash(files):
                raise PackError(files.folder, "would not say the same when laid out, so nothing is written")
            for file in texts:
                (fresh.folder / file.name).replace(file)
    except OSError as error:
        raise PackError(files.folder, f"cannot be written: {error.strerror}") from error
    return list(texts)


def not_laid_out(files: PackFiles) -> list[Path]:
    """Return the files that `lay_out` would change.

    Raises:
        PackError: A file is missing or cannot be parsed.
    """
    return list(_laid_out(files))


def _laid_out(files: PackFiles) -> dict[Path, str]:
    """Return the formatted text of each file that is not formatted."""
    found: dict[Path, str] = {}
    for file, lay in ((files.json, lay_out_json), (files.mjcf, lay_out_xml)):
        try:
            text = file.read_text(encoding="utf-8")
            laid = lay(text)
        except OSError as error:
            raise PackError(file, f"cannot be read: {error.strerror}") from error
        except (ValueError, SyntaxError) as error:  # the errors of both parsers derive from these
            raise PackError(file, f"cannot be laid out: {error}") from error
        if laid != text:
            found[file] = laid
    return found


def lay_out_json(text: str) -> str:
    """Format JSON with one line per field of the outermost object, and inner values on one line where they fit.

    Raises:
        ValueError: The text is not JSON.
    """
    json.loads(text)
    return _json_text(_json_node(deque(_JSON_TOKEN.findall(text))), "", 0) + "\n"


def _json_node(tokens: deque[str]) -> _Node:
    """Parse a value from the front of the tokens."""
    opening = tokens.popleft()
    if opening not in {"[", "{"}:
        return opening
    items: _Items = []
    while tokens[0] not in {"]", "}"}:
        before = ""
        if opening == "{":
            before = f"{tokens.popleft()}{tokens.popleft()} "
        items.append((before, _json_node(tokens)))
        if tokens[0] == ",":
            tokens.popleft()
    return opening, items, tokens.popleft()


def _json_text(node: _Node, indent: str, taken: int) -> str:
    """Format a value.

    Args:
        node: The value.
        indent: Indent of the line on which the value begins.
        taken: Number of other characters on that line.
    """
    line = _json_line(node)
    if isinstance(node, str) or not node[1] or (indent and taken + len(line) <= WIDTH):
        return line
    opening, items, closing = node
    inner = indent + _INDENT
    parts = [
        f"{inner}{before}{_json_text(item, inner, len(inner) + len(before) + (number < len(items)))}"
        for number, (before, item) in enumerate(items, start=1)
    ]
    return "\n".join((opening, ",\n".join(parts), indent + closing))


def _json_line(node: _Node) -> str:
    if isinstance(node, str):
        return node
    opening, items, closing = node
    return f"{opening}{', '.join(before + _json_line(item) for before, item in items)}{closing}"


def lay_out_xml(text: str) -> str:
    """Format XML with one tag per line; attributes that do not fit are aligned below the first one.

    Raises:
        SyntaxError: The text is not XML.
        ValueError: It contains node types that MuJoCo models do not use and in which white space may be content.
    """
    ET.fromstring(text)  # noqa: S314 - packs are local files the operator named
    tokens = [token for token in _XML_TOKEN.findall(text) if not token.isspace()]
    return "".join(f"{line}\n" for line in _xml_lines(tokens))


def _xml_lines(tokens: Sequence[str]) -> Iterator[str]:
    depth, childless = 0, False
    for number, token in enumerate(tokens, start=1):
        if token.startswith(("<!--", "<?")):
            yield _INDENT * depth + token
        elif token.startswith("<!") or not token.startswith("<"):
            raise ValueError(f"only elements and comments can be laid out, not {token.strip()[:40]!r}")
        elif token.startswith("</"):
            if not childless:
                depth -= 1
                yield f"{_INDENT * depth}</{token[2:-1].strip()}>"
            childless = False
        else:
            childless = not token.endswith("/>") and tokens[number].startswith("</")
            yield _xml_tag(token, _INDENT * depth, closed=childless)
            depth += not token.endswith("/>") and not childless


def _xml_tag(token: str, indent: str, *, closed: bool) -> str:
    """Format a start tag on as many lines as it needs."""
    tag = _XML_TAG.fullmatch(token)
    assert tag is not None
    end = "/>" if closed else tag["end"]
    lines = [f"{indent}<{tag['name']}"]
    below = " " * (len(lines[0]) + 1)
    attributes = [f"{name}={value}" for name, value in _XML_ATTRIBUTE.findall(tag["attributes"])]
    for number, attribute in enumerate(attributes, start=1):
        needed = 1 + len(attribute) + (len(end) if number == len(attributes) else 0)
        if number > 1 and len(lines[-1]) + needed > WIDTH:
            lines.append(below + attribute)
        else:
            lines[-1] += f" {attribute}"
    return "\n".join(lines) + end
