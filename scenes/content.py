"""The content hash of a pack, which does not depend on its layout, and the conversion of older byte hashes.

Parses the JSON, XML and Python files of a pack; runs none of them.
"""

import ast
import functools
import hashlib
import json
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, cast

from scenes.folder import PackFiles

_PREFIX = "c1:"
"""Prefix of a content hash that is computed by version 1 of these rules. A byte hash has no prefix."""
_DIGITS = 12
_TABLE = Path(__file__).with_name("byte_hashes.json")
"""Byte hash of a pack of the suite before the packs were formatted → its content hash."""
_IN_ORDER = frozenset({"objects", "knobs", "derive", "apply"})
"""Fields of `scene{N}.json` whose order matters."""
_DRAWN_ONLY = "schematic"
"""Field of `scene{N}.json` that affects only drawings."""
_NUMBER_LISTS = frozenset(
    {"act", "axis", "axisangle", "ctrl", "ctrlrange", "diaginertia", "dir", "euler", "forcerange", "friction", "fromto"}
    | {"fullinertia", "gear", "gravity", "magnetic", "polycoef", "pos", "qpos", "quat", "qvel", "range", "rgba", "size"}
    | {"solimp", "solimpfriction", "solimplimit", "solref", "solreffriction", "solreflimit", "springdamper"}
    | {"springlength", "wind", "xyaxes", "zaxis"}
)
"""Attributes that MuJoCo reads as numbers separated by white space. In all others, white space is content."""
_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)


def pack_hash(files: PackFiles) -> str:
    """Return a short hash of a pack's content, by which a record identifies the pack.

    White space, comments, docstrings, the order of fields and attributes, and the `schematic` do not change it. Every
    other change does, including that of a number's type, because `solution.py` may distinguish `1` from `1.0`. If a
    file cannot be parsed, its bytes are hashed.
    """
    parts = [
        (file.name, _content(file, read))
        for file, read in ((files.json, _json), (files.mjcf, _mjcf), (files.solution, _code))
    ]
    return _PREFIX + hashlib.sha256(json.dumps(parts).encode()).hexdigest()[:_DIGITS]


def content_hash_of(stored: str) -> str:
    """The content hash for a stored hash. Older byte hashes are looked up in a table.

    A hash that is not in the table is returned unchanged.
    """
    return _table().get(stored, stored)


def same_pack(stored: str, files: PackFiles) -> bool:
    """Return whether a stored hash, of content or of bytes, belongs to this pack."""
    # The table has only packs of the suite. Other packs are recognised as long as their bytes are unchanged.
    return content_hash_of(stored) == pack_hash(files) or stored == byte_hash(files)


def same_packs(stored: Mapping[str, str], packs: Iterable[PackFiles]) -> bool:
    """Return whether the packs of a stored run (scene → hash) are exactly these packs."""
    found = {str(files.scene_id): files for files in packs}
    return stored.keys() == found.keys() and all(same_pack(stored[scene], files) for scene, files in found.items())


def byte_hash(files: PackFiles) -> str:
    """The hash of a pack's bytes, which older records contain instead of the content hash."""
    digest = hashlib.sha256()
    for file in (files.json, files.mjcf, files.solution):
        digest.update(file.name.encode())
        digest.update(file.read_bytes() if file.is_file() else b"")
    return digest.hexdigest()[:_DIGITS]


@functools.cache
def _table() -> Mapping[str, str]:
    return json.loads(_TABLE.read_text(encoding="utf-8"))


def _content(file: Path, read: Callable[[bytes], str]) -> str | list[str] | None:
    """The content of a file in a canonical form; None if there is no file."""
    if not file.is_file():
        return None
    content = file.read_bytes()
    try:
        return read(content)
    except (ValueError, SyntaxError):  # the errors of all three parsers derive from these two
        return ["bytes", content.hex()]


def _json(content: bytes) -> str:
    pack = json.loads(content.decode("utf-8"))
    if isinstance(pack, dict):
        fields = cast("dict[str, Any]", pack)
        pack = {name: _pairs(value) if name in _IN_ORDER else value for name, value in fields.items()}
        pack.pop(_DRAWN_ONLY, None)
        if isinstance(laws := fields.get("laws"), list):
            pack["laws"] = [_law(law) for law in cast("list[Any]", laws)]
    return json.dumps(pack, sort_keys=True)


def _law(value: Any) -> Any:
    """Return a law with `let` as a list of pairs, because its quantities are computed in this order."""
    if not isinstance(value, dict):
        return value
    law = cast("dict[str, Any]", value)
    return law | {"let": _pairs(law["let"])} if "let" in law else law


def _pairs(value: Any) -> Any:
    return list(cast("dict[str, Any]", value).items()) if isinstance(value, dict) else value


def _mjcf(content: bytes) -> str:
    text = content.decode("utf-8")
    if "<!DOCTYPE" in text:
        raise ValueError("MuJoCo does not expand what a document type defines, and this parser would")
    root = ET.fromstring(text)  # noqa: S314 - packs are local files the operator named
    for element in root.iter():
        for name, value in element.items():
            if name in _NUMBER_LISTS:
                element.set(name, " ".join(part for part in value.split(" ") if part))
    return ET.canonicalize(ET.tostring(root, encoding="unicode"), strip_text=True)


def _code(content: bytes) -> str:
    return json.dumps(_tree(ast.parse(content)))


def _tree(node: Any) -> Any:
    """A syntax tree as nested lists, which are the same in every Python version, unlike the text of `ast.dump`."""
    if isinstance(node, list):
        return [_tree(item) for item in cast("list[Any]", node)]
    if isinstance(node, ast.Constant):
        return ["Constant", ascii(node.value)]
    if not isinstance(node, ast.AST):
        return node
    # Newer versions of Python add fields. They are empty if the source uses no new syntax.
    fields = {name: _tree(value) for name, value in ast.iter_fields(node) if value is not None and value != []}
    if isinstance(node, ast.JoinedStr):
        # Python 3.12 adds empty texts to the formats in f-strings.
        fields["values"] = [value for value in fields.get("values", []) if value != ["Constant", "''"]]
    if isinstance(node, _DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
        del fields["body"][0]
    return [type(node).__name__, fields]
