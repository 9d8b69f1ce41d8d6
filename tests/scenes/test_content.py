"""Tests of the pack hash: it depends on content and not on layout; older byte hashes are still understood."""

import ast
import json
import random
import re
import shutil
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenes import PackFiles, content_hash_of, default_folder, find_pack, list_packs, pack_hash, same_pack, same_packs
from scenes.content import byte_hash

Write = Callable[..., PackFiles]
WORLD = """\
<mujoco>
  <option gravity="0 0 -9.81"/>
  <worldbody>
    <body name="object_1" pos="0 0 1"><geom name="a" size="0.1" mass="2"/></body>
  </worldbody>
</mujoco>
"""
CODE = '''\
"""A fall."""


def solve(task):
    """One fall."""
    yield [1, 2.5]  # a comment
'''


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Write a pack and return its files."""

    def written(pack: str = "{}", world: str = WORLD, code: str = CODE) -> PackFiles:
        files = PackFiles(7, tmp_path / "Scene7")
        files.folder.mkdir(exist_ok=True)
        files.json.write_text(pack, encoding="utf-8")
        files.mjcf.write_text(world, encoding="utf-8")
        files.solution.write_text(code, encoding="utf-8")
        return files

    return written


def test_every_pack_of_the_suite_has_a_hash_of_its_own_that_says_how_it_was_made() -> None:
    hashes = [pack_hash(files) for files in list_packs()]
    assert all(re.fullmatch(r"c1:[0-9a-f]{12}", found) for found in hashes)
    assert len(set(hashes)) == len(hashes)


@pytest.mark.parametrize(
    ("old", "new", "same"),
    [
        ('{"a": 1}', '{\n  "a" :1\n}\n', True),
        ('{"a": 0.5}', '{"a": 0.50}', True),
        ('{"a": 1000.0}', '{"a": 1e3}', True),
        ('{"a": "m²"}', r'{"a": "m\u00b2"}', True),
        ('{"a": 1, "b": 2}', '{"b": 2, "a": 1}', True),
        ('{"a": 1}', '{"a": 1.0}', False),
        ('{"a": 1}', '{"a": true}', False),
        ('{"a": 1}', '{"a": "1"}', False),
        ('{"a": 0.1}', '{"a": 0.10000000000000002}', False),
        ('{"a": [1, 2]}', '{"a": [2, 1]}', False),
        ('{"a": null}', "{}", False),
        ('{"derive": {"a": 1, "b": 2}}', '{"derive": {"b": 2, "a": 1}}', False),
        ('{"laws": [{"let": {"a": 1, "b": 2}}]}', '{"laws": [{"let": {"b": 2, "a": 1}}]}', False),
        ('{"laws": [{"on": 1, "force": 2}]}', '{"laws": [{"force": 2, "on": 1}]}', True),
        ('{"a": 1, "schematic": [1]}', '{"a": 1}', True),
        ('{"laws": [1]}', '{"laws": [1.0]}', False),
        ('{"objects": {"a": {"x": 1, "y": 2}}}', '{"objects": {"a": {"y": 2, "x": 1}}}', True),
        ("{", "{ ", False),
    ],
)
def test_json_is_compared_by_value_and_type(old: str, new: str, *, same: bool, write: Write) -> None:
    before = pack_hash(write(pack=old))
    assert (pack_hash(write(pack=new)) == before) is same


@pytest.mark.parametrize(
    ("old", "new", "same"),
    [
        ("<mujoco>", "<?xml version='1.0'?>\n<mujoco>\n\n<!-- a fall -->", True),
        ('name="a" size="0.1"', "size='0.1'\n   name='a'", True),
        ('"0 0 -9.81"', '" 0 0\n  -9.81"', True),
        ('mass="2"/>', 'mass="2"></geom>', True),
        ('mass="2"', 'mass="2.0"', False),
        ('mass="2"', "", False),
        ('name="object_1"', 'name="object_1 "', False),
        ('name="object_1"', 'name="0 1"', False),
        ("<worldbody>", "<worldbody><body/>", False),
        ("</mujoco>", "", False),
        ("<mujoco>", '<!DOCTYPE mujoco [<!ENTITY m "2">]>\n<mujoco>', False),
    ],
)
def test_a_model_is_compared_as_canonical_xml(old: str, new: str, *, same: bool, write: Write) -> None:
    before = pack_hash(write())
    assert old in WORLD
    assert (pack_hash(write(world=WORLD.replace(old, new))) == before) is same


def test_white_space_in_a_name_is_content(write: Write) -> None:
    hashes = {pack_hash(write(world=WORLD.replace('"a"', name))) for name in ('"0 1"', '"0  1"', '"0 1 "')}
    assert len(hashes) == 3


@pytest.mark.parametrize(
    ("old", "new", "same"),
    [
        ("  # a comment", "", True),
        ('"""One fall."""', '"""Another\n    text."""', True),
        ('    """One fall."""\n', "", True),
        ('"""A fall."""\n', "", True),
        ("[1, 2.5]", "[\n        1,\n        2.50,\n    ]", True),
        ("[1, 2.5]", "[1.0, 2.5]", False),
        ("[1, 2.5]", '[1, "2.5"]', False),
        ("[1, 2.5]", "(1, 2.5)", False),
        ("yield [1, 2.5]", "yield [1, 2.5]\n    yield", False),
        ("solve", "theory", False),
        ("yield", "yield = ", False),
    ],
)
def test_code_is_compared_by_its_syntax_tree(old: str, new: str, *, same: bool, write: Write) -> None:
    before = pack_hash(write())
    assert old in CODE
    assert (pack_hash(write(code=CODE.replace(old, new))) == before) is same


def test_the_tree_of_code_is_the_same_in_every_version_of_python(write: Write) -> None:
    code = """\
async def f(a, *, b=1):
    return f"{a!r:>{b}} {b=}" u"x" or {**a, "k": [i async for i in ...]} if b is None else -1.5
"""
    assert pack_hash(write(code=code)) == "c1:234652e0b0cb"


def test_a_missing_file_is_not_an_empty_one(write: Write) -> None:
    files = write(code="")
    empty = pack_hash(files)
    files.solution.unlink()
    assert pack_hash(files) != empty


# Any layout, and any small edit, of real packs

SAMPLE = [find_pack(scene) for scene in (7, 21, 54, 101)]


def relaid(files: PackFiles, folder: Path, draw: random.Random) -> PackFiles:
    """Return a copy of a pack whose files have another layout."""
    copied = PackFiles(files.scene_id, folder)
    pack = json.loads(files.json.read_text(encoding="utf-8"))
    fields = list(pack.items())
    draw.shuffle(fields)
    text = json.dumps(dict(fields), indent=draw.choice([None, 0, 1, 7]), ensure_ascii=draw.random() < 0.5)
    copied.json.write_text(text, encoding="utf-8")
    root = ET.fromstring(files.mjcf.read_text(encoding="utf-8"))
    for element in root.iter():
        attributes = list(element.attrib.items())
        draw.shuffle(attributes)
        element.attrib.clear()
        element.attrib.update(attributes)
    if draw.random() < 0.5:
        ET.indent(root, " " * draw.randint(0, 8))
    root.insert(draw.randint(0, len(root)), ET.Comment("a comment"))
    copied.mjcf.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
    code = files.solution.read_text(encoding="utf-8")
    copied.solution.write_text(ast.unparse(ast.parse(code)) + "\n# a comment\n", encoding="utf-8")
    return copied


@given(st.sampled_from(SAMPLE), st.randoms(use_true_random=False))
def test_no_layout_changes_the_hash(
    tmp_path_factory: pytest.TempPathFactory, files: PackFiles, draw: random.Random
) -> None:
    assert pack_hash(relaid(files, tmp_path_factory.mktemp("pack"), draw)) == pack_hash(files)


def places(value: Any) -> Iterator[tuple[Any, Any]]:
    """Yield the location of every value in a JSON document: its container, and its key or index there."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for name, inner in items:
        yield value, name
        yield from places(inner)


def altered(value: Any) -> Any:
    if isinstance(value, bool):
        return not value
    if isinstance(value, int | float):
        return value + 1
    return f"{value} " if isinstance(value, str) else None


@given(st.sampled_from(SAMPLE), st.data())
def test_every_change_of_a_value_changes_the_hash(
    tmp_path_factory: pytest.TempPathFactory, files: PackFiles, data: st.DataObject
) -> None:
    folder = tmp_path_factory.mktemp("pack")
    edited = PackFiles(files.scene_id, folder)
    for source in (files.json, files.mjcf, files.solution):
        shutil.copy(source, folder)
    kind = data.draw(st.sampled_from(["json", "attribute", "line"]))
    if kind == "json":
        pack = json.loads(files.json.read_text(encoding="utf-8"))
        pack.pop("schematic", None)
        holder, name = data.draw(st.sampled_from(list(places(pack))))
        holder[name] = altered(holder[name])
        edited.json.write_text(json.dumps(pack), encoding="utf-8")
    elif kind == "attribute":
        root = ET.fromstring(files.mjcf.read_text(encoding="utf-8"))
        element = data.draw(st.sampled_from([element for element in root.iter() if element.attrib]))
        name = data.draw(st.sampled_from(list(element.attrib)))
        element.set(name, element.attrib[name] + data.draw(st.sampled_from(["1", " 1", "e0"])))
        edited.mjcf.write_text(ET.tostring(root, encoding="unicode"), encoding="utf-8")
    else:
        tree = ast.parse(files.solution.read_text(encoding="utf-8"))
        numbers = [node for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, float)]
        node = data.draw(st.sampled_from(numbers))
        node.value = altered(node.value)
        edited.solution.write_text(ast.unparse(tree), encoding="utf-8")
    assert pack_hash(edited) != pack_hash(files)


# Hashes of bytes, which older records contain


def test_the_table_holds_all_packs_as_they_were_when_hashes_were_of_bytes() -> None:
    table = json.loads((default_folder() / "byte_hashes.json").read_text(encoding="utf-8"))
    assert len(table) == len(set(table.values())) == 105
    assert all(re.fullmatch(r"[0-9a-f]{12}", old) for old in table)
    assert all(content_hash_of(old) == new == content_hash_of(new) for old, new in table.items())
    assert content_hash_of("000000000000") == "000000000000"


def test_a_pack_that_no_table_knows_is_recognised_by_its_bytes_too(write: Write) -> None:
    files = write()
    old, new = byte_hash(files), pack_hash(files)
    assert same_pack(old, files)
    assert same_pack(new, files)
    write(code=CODE + "\n")
    assert not same_pack(old, files)
    assert same_pack(new, files)


def test_the_packs_of_a_run_are_the_same_if_all_are_and_no_others(write: Write) -> None:
    files = write()
    assert same_packs({"7": byte_hash(files)}, [files])
    assert not same_packs({"7": "c1:000000000000"}, [files])
    assert not same_packs({"7": pack_hash(files), "8": "c1:000000000000"}, [files])
    assert not same_packs({}, [files])
