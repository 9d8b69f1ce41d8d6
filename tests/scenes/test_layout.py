"""Tests of the formatter of packs: content is unchanged, and formatting twice changes nothing."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenes import Category, PackError, PackFiles, find_pack, list_packs, pack_hash, write_new_scene
from scenes.layout import WIDTH, lay_out, lay_out_json, lay_out_xml, not_laid_out

Write = Callable[[str, str], PackFiles]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Write a pack and return its files."""

    def written(pack: str, world: str) -> PackFiles:
        files = PackFiles(7, tmp_path / "Scene7")
        files.folder.mkdir(exist_ok=True)
        files.json.write_text(pack, encoding="utf-8")
        files.mjcf.write_text(world, encoding="utf-8")
        return files

    return written


def test_the_outermost_fields_have_lines_of_their_own_and_inner_values_share_one_where_they_fit() -> None:
    long = ", ".join(f'"an option of some length, number {number}"' for number in range(3))
    text = f'{{"a":[1,\n2.50,1e-3 ],"b": {{}},"c":{{"x":[{long}],"y":{{"z":null}}}}, "m²":"µ\\u00b5 [1, 2]"}}'
    assert lay_out_json(text) == (
        "{\n"
        '  "a": [1, 2.50, 1e-3],\n'
        '  "b": {},\n'
        '  "c": {\n'
        '    "x": [\n'
        '      "an option of some length, number 0",\n'
        '      "an option of some length, number 1",\n'
        '      "an option of some length, number 2"\n'
        "    ],\n"
        '    "y": {"z": null}\n'
        "  },\n"
        '  "m²": "µ\\u00b5 [1, 2]"\n'
        "}\n"
    )


def test_a_line_is_full_at_the_width_with_its_comma() -> None:
    fits = "x" * (WIDTH - len('  "a": [""],'))
    assert lay_out_json(f'{{"a": ["{fits}"], "b": 1}}').splitlines()[1] == f'  "a": ["{fits}"],'
    assert lay_out_json(f'{{"a": ["{fits}x"], "b": 1}}').splitlines()[1] == '  "a": ['
    assert lay_out_json(f'{{"b": 1, "a": ["{fits}x"]}}').splitlines()[2] == f'  "a": ["{fits}x"]'


def test_tags_are_indented_and_attributes_that_do_not_fit_go_on_below_the_first() -> None:
    attributes = " ".join(f'value_{number}="0 0 {number}"' for number in range(8))
    text = (
        "<?xml version='1.0'?><!-- a world -->\n\n<mujoco >\n   <body  name = 'a\"b'\n\tpos=\"0  0 1\"></body>"
        f"<worldbody><geom {attributes}/>   <!-- two\n lines --></worldbody ></mujoco>"
    )
    assert lay_out_xml(text) == (
        "<?xml version='1.0'?>\n"
        "<!-- a world -->\n"
        "<mujoco>\n"
        '  <body name=\'a"b\' pos="0  0 1"/>\n'
        "  <worldbody>\n"
        '    <geom value_0="0 0 0" value_1="0 0 1" value_2="0 0 2" value_3="0 0 3" value_4="0 0 4" value_5="0 0 5"\n'
        '          value_6="0 0 6" value_7="0 0 7"/>\n'
        "    <!-- two\n"
        " lines -->\n"
        "  </worldbody>\n"
        "</mujoco>\n"
    )


JSON_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(),
    lambda inner: st.lists(inner) | st.dictionaries(st.text(), inner),
    max_leaves=15,
)


@settings(max_examples=40)
@given(st.dictionaries(st.text(), JSON_VALUES), st.booleans(), st.sampled_from([None, 0, 3]))
def test_any_json_keeps_its_values_and_is_laid_out_once(value: object, ascii_only: bool, indent: int | None) -> None:
    text = json.dumps(value, ensure_ascii=ascii_only, indent=indent)
    laid = lay_out_json(text)
    # Through text, because 1, 1.0 and true are equal to Python.
    assert json.dumps(json.loads(laid)) == json.dumps(value)
    assert lay_out_json(laid) == laid


def test_every_pack_of_the_suite_and_every_new_scene_is_laid_out(tmp_path: Path) -> None:
    for number, category in enumerate(Category):
        write_new_scene(tmp_path, number, category)
    assert [file for files in (*list_packs(), *list_packs(tmp_path)) for file in not_laid_out(files)] == []


def test_laying_out_keeps_the_hash_and_a_second_time_changes_nothing(write: Write) -> None:
    suite = find_pack(7)
    pack = json.loads(suite.json.read_text(encoding="utf-8"))
    files = write(json.dumps(pack, ensure_ascii=False), suite.mjcf.read_text(encoding="utf-8").replace("\n", " "))
    before = pack_hash(files)
    assert not_laid_out(files) == [files.json, files.mjcf]
    assert lay_out(files) == [files.json, files.mjcf]
    assert pack_hash(files) == before
    assert files.json.read_bytes() == suite.json.read_bytes()
    assert files.mjcf.read_bytes() == suite.mjcf.read_bytes()
    assert lay_out(files) == []
    assert sorted(path.name for path in files.folder.iterdir()) == ["scene7.json", "scene7.xml"]


@pytest.mark.parametrize(
    ("pack", "world", "said"),
    [
        ('{"a": 1,}', "<mujoco/>", "scene7.json: cannot be laid out: Expecting property name"),
        ('{ "a": 1}', "<mujoco>", "scene7.xml: cannot be laid out: no element found"),
        ('{ "a": 1}', "<mujoco>words</mujoco>", "only elements and comments can be laid out, not 'words'"),
        ('{ "a": 1}', "<mujoco><![CDATA[a]]></mujoco>", "only elements and comments can be laid out"),
        ('{ "a": 1}', "<!DOCTYPE mujoco><mujoco/>", "only elements and comments can be laid out"),
    ],
)
def test_what_cannot_be_laid_out_is_said_and_neither_file_is_touched(
    pack: str, world: str, said: str, write: Write
) -> None:
    files = write(pack, world)
    with pytest.raises(PackError, match="cannot be laid out") as refused:
        lay_out(files)
    assert said in str(refused.value)
    assert (files.json.read_text(encoding="utf-8"), files.mjcf.read_text(encoding="utf-8")) == (pack, world)


def test_a_missing_file_is_said(write: Write) -> None:
    files = write("{}", "<mujoco/>")
    files.mjcf.unlink()
    with pytest.raises(PackError, match=r"scene7\.xml: cannot be read: No such file"):
        not_laid_out(files)
