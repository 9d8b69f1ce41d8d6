"""Tests that all seeds take equal computing time: equal numbers of laws and parts, finite values of disabled laws."""

import json
from typing import Any
from xml.sax.saxutils import quoteattr

import pytest

from evaluator.certify.drawn_parts import (
    absent_laws_without_value,
    model_faults,
    models_of,
    unequal_laws,
    unequal_parts,
)
from scenes import PackFiles, list_packs, read_pack

OWN = [files for files in list_packs() if read_pack(files).predicts]


def model(*laws: Any, more: str = "", joint: str = "", rest: str = "") -> str:
    text = f'<custom><text name="laws" data={quoteattr(json.dumps(laws))}/></custom>' if laws else ""
    return (
        f'<mujoco>{text}<worldbody><body name="object_1"><joint name="rail" type="slide" axis="1 0 0" {joint}/>'
        f'<geom size="0.1" mass="1"/></body>{more}</worldbody>{rest}</mujoco>'
    )


LAW = {"on": "object_1", "force": ["-vx", "0", "0"]}


def test_equal_models_tell_nothing() -> None:
    assert list(unequal_laws([model(LAW), model(LAW | {"factor": 0.0})])) == []
    assert list(unequal_parts([model(), model(joint='stiffness="3"')])) == []


def test_a_law_that_is_left_out_at_some_seeds_is_found() -> None:
    (sentence,) = unequal_laws([model(LAW), model(LAW), model()])
    assert "the number of laws is 1 at seed 0 and 0 at seed 2" in sentence


@pytest.mark.parametrize(
    ("other", "kind"),
    [
        (model(more='<body name="b" pos="0 1 0"/>'), "bodies is 2"),
        (model(rest='<tendon><fixed name="t"><joint joint="rail" coef="1"/></fixed></tendon>'), "tendons is 0"),
        (model(rest='<equality><joint joint1="rail"/></equality>'), "equality constraints is 0"),
        (model(rest='<actuator><motor joint="rail"/></actuator>'), "actuators is 0"),
        (model(more='<geom size="0.1" pos="0 9 0"/>'), "geoms that can collide is 1"),
        (model(joint='frictionloss="2"'), "rows of the constraint solver at the start is 0"),
        (model(rest='<option density="1.2"/>'), "bodies in a fluid is 0"),
        (model(rest='<option viscosity="1e-5"/>'), "bodies in a fluid is 0"),
    ],
)
def test_a_part_that_is_left_out_at_some_seeds_is_found(other: str, kind: str) -> None:
    found = list(unequal_parts([model(), model(), other]))
    assert any(f"the number of {kind} at seed 0" in sentence for sentence in found), found
    assert list(unequal_parts([other, other])) == []


@pytest.mark.parametrize("force", ["(0.1 - x)**0.5", "exp(1000*x)*1e300", "log(0.2 - x)"])
def test_a_law_that_is_not_present_and_has_no_value_somewhere_is_found(force: str) -> None:
    absent = {"on": "object_1", "force": [f"{force} if x > 0.1 else 0", "0", "0"], "factor": 0.0}
    (sentence,) = absent_laws_without_value([model(LAW), model(absent, LAW)], ["object_1"], 5.0, 0.0)
    assert "at seed 1 a law that is not present has no finite value in motion" in sentence
    assert list(absent_laws_without_value([model(absent)], ["object_1"], 0.0, 0.0)) == []
    # A law that is present is not reported here: it makes the step fail.
    assert list(absent_laws_without_value([model(absent | {"factor": 1.0}, LAW)], ["object_1"], 5.0, 0.0)) == []


@pytest.mark.parametrize("files", [f for f in OWN if read_pack(f).laws], ids=lambda files: str(files.scene_id))
def test_the_laws_of_the_suite_tell_nothing_of_the_draw(files: PackFiles) -> None:
    assert list(model_faults(files, read_pack(files))) == []


@pytest.mark.parametrize("files", OWN, ids=lambda files: str(files.scene_id))
def test_the_parts_of_the_suite_tell_nothing_of_the_draw(files: PackFiles) -> None:
    assert list(unequal_parts(models_of(files, read_pack(files)))) == []
