"""Tests of models at a seed: targets by path, absent parts, laws with sampled constants, modified apparatus."""

import json
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import pytest

from scenes import PackError, PackFiles, changed_mjcf, draw_knobs, drawn_mjcf, read_pack

XML = """<mujoco>
 <worldbody>
  <body name="object_1"><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
   <joint name="rail" type="slide"/><joint name="stop" type="slide" present="kind == 'stop'"/></body>
  <body name="object_2"><inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/><joint name="other" type="slide"/></body>
 </worldbody>
 <tendon>
  <fixed name="cord" present="kind != 'free'"><joint joint="rail" coef="1"/><joint joint="other" coef="-1"/></fixed>
 </tendon>
</mujoco>"""
KNOBS = {
    "kind": {"canonical": "stop", "choice": ["stop", "cord", "free"]},
    "m": {"canonical": 1.0, "uniform": [1, 5]},
    "order": {"canonical": [1, 2], "permutation": [1, 2]},
}
PACK = {
    "metadata": {"scene_name": "a", "task": "b", "problem_type": "calculation"},
    "answer": 1,
    "objects": {"object_1": {"name": "cart", "object_id": 1}},
    "knobs": KNOBS,
}


@pytest.fixture
def packed(tmp_path: Path) -> Any:
    """Writes a pack with these fields; returns its files."""

    def write(**fields: Any) -> PackFiles:
        files = PackFiles(7, tmp_path / "Scene7")
        files.folder.mkdir(exist_ok=True)
        files.json.write_text(json.dumps(PACK | fields), encoding="utf-8")
        files.mjcf.write_text(XML, encoding="utf-8")
        return files

    return write


def drawn(files: PackFiles, *, canonical: bool = False, **values: Any) -> ET.Element:
    pack = read_pack(files)
    knobs = draw_knobs(files, pack, 0) | values
    return ET.fromstring(drawn_mjcf(files, pack, knobs, canonical=canonical))


def test_a_target_may_name_an_element_by_the_one_that_holds_it(packed: Any) -> None:
    files = packed(apply={"body[object_2]/inertial.mass": "7 * m", "fixed[cord]/joint[other].coef": "-m"})
    root = drawn(files, m=2.0)
    assert [element.get("mass") for element in root.iter("inertial")] == ["1", "14.0"]
    assert [element.get("coef") for element in root.find("tendon/fixed") or ()] == ["1", "-2.0"]


@pytest.mark.parametrize("target", ["body[object_1]/geom.mass", "body[object_1]/joint.range", "joint[rail]", "a//b.c"])
def test_a_path_names_exactly_one_element(packed: Any, target: str) -> None:
    with pytest.raises(PackError, match=r"names . elements of the model, not one|write targets as"):
        drawn(packed(apply={target: "m"}))


@pytest.mark.parametrize(("kind", "joints", "cords"), [("stop", 3, 1), ("cord", 2, 1), ("free", 2, 0)])
@pytest.mark.parametrize("canonical", [True, False])
def test_an_element_whose_condition_is_false_is_left_out(
    packed: Any, kind: str, joints: int, cords: int, canonical: bool
) -> None:
    root = drawn(packed(), canonical=canonical, kind=kind)
    assert len(root.findall("worldbody/body/joint")) == joints
    assert len(root.findall("tendon/fixed")) == cords
    assert "present" not in ET.tostring(root, encoding="unicode")


def test_a_wrong_condition_is_named_with_its_element(packed: Any) -> None:
    files = packed()
    files.mjcf.write_text(XML.replace("kind == 'stop'", "kin == 1"), encoding="utf-8")
    with pytest.raises(PackError, match=r"present of <joint> in scene7\.xml"):
        drawn(files)


def test_a_law_takes_the_drawn_values_that_it_names_into_the_model(packed: Any) -> None:
    law = {
        "on": "object_1", "with": {"far": "object_2"}, "let": {"r": "far_x - x"}, "reaction": "far",
        "force": ["k2 * r * m", 0, "0"], "present": "kind != 'free'",
    }  # fmt: skip
    files = packed(laws=[law], derive={"k2": "3 * m", "unused": "1"})
    (text,) = drawn(files, kind="cord").findall("custom/text")
    assert text.get("name") == "laws"
    assert json.loads(text.get("data") or "") == [
        {
            "on": "object_1", "with": {"far": "object_2"}, "let": {"r": "far_x - x"}, "reaction": "far",
            "force": ["k2 * r * m", "0", "0"], "torque": ["0", "0", "0"], "constants": {"m": 1.0, "k2": 3.0},
            "factor": 1.0,
        }
    ]  # fmt: skip


def test_a_law_whose_condition_is_false_stays_in_the_model_with_factor_0(packed: Any) -> None:
    """Steps would take less time without the law, so their duration would reveal the hidden value."""
    law = {"on": "object_1", "let": {"r": "x * m"}, "force": ["r", "0", "0"], "present": "kind == 'cord'"}
    files = packed(laws=[law, {"on": "object_2", "force": ["-x", "0", "0"]}])
    written = {
        kind: json.loads(next(drawn(files, kind=kind).iterfind("custom/text")).get("data") or "")
        for kind in ("stop", "cord", "free")
    }
    assert {kind: [law.pop("factor") for law in laws] for kind, laws in written.items()} == {
        "stop": [0.0, 1.0],
        "cord": [1.0, 1.0],
        "free": [0.0, 1.0],
    }
    assert written["stop"] == written["cord"] == written["free"]


def test_an_unknown_field_of_a_law_is_refused(packed: Any) -> None:
    with pytest.raises(PackError, match=r"field laws\.0\.reactions"):
        read_pack(packed(laws=[{"on": "object_1", "reactions": "far"}]))


def test_a_law_with_a_torque_has_no_reaction(packed: Any) -> None:
    both = {"on": "object_1", "with": {"far": "object_2"}, "torque": ["0", "0", "1"], "reaction": "far"}
    with pytest.raises(PackError, match=r"laws\.0.*`reaction` belongs to a force and not to a torque"):
        read_pack(packed(laws=[both]))


def test_an_apparatus_is_changed_by_values_and_by_elements_left_out() -> None:
    changed = ET.fromstring(
        changed_mjcf(XML, {"body[object_1]/inertial.mass": 5.5, "joint[rail].axis": (0, 1, 0)}, ("joint[stop]",))
    )
    assert [element.get("mass") for element in changed.iter("inertial")] == ["5.5", "2"]
    assert [joint.get("name") for joint in changed.findall("worldbody/body/joint")] == ["rail", "other"]
    assert changed.find("worldbody/body/joint").get("axis") == "0 1 0"  # pyright: ignore[reportOptionalMemberAccess]
    with pytest.raises(ValueError, match="names 0 elements"):
        changed_mjcf(XML, {"joint[none].axis": 1})
    with pytest.raises(ValueError, match="names 0 elements"):
        changed_mjcf(XML, {}, ("geom[none]",))
