"""Tests that results on other engines are judged correctly, and measured as on the locked engine."""

import re
from importlib.metadata import version

import pytest

from evaluator.certify.subject import Subject
from scenes import find_pack
from tests.harness.engines.environments import LOCK, versions_of, without_engine
from tests.harness.engines.measuring import measured
from tests.harness.engines.run import other_key, row_of


def test_an_environment_has_all_locked_packages_but_the_engine() -> None:
    lock = LOCK.read_text(encoding="utf-8")
    names = re.compile(r"^([\w.-]+)==", re.MULTILINE)
    rest = without_engine(lock)
    assert set(names.findall(lock)) - set(names.findall(rest)) == {"mujoco"}
    assert len(lock.splitlines()) - len(rest.splitlines()) > 2  # its hashes are gone too


def test_a_package_that_is_locked_twice_keeps_the_pythons_of_each_version() -> None:
    lock = (
        "numpy==1.0 ; python_version < '3.12' \\\n    --hash=sha256:0\nnumpy==2.0 ; python_version >= '3.12'\npip==3\n"
    )
    assert versions_of(lock).splitlines() == [
        "numpy==1.0 ; python_version < '3.12'",
        "numpy==2.0 ; python_version >= '3.12'",
        "pip==3",
    ]


def test_the_locked_engine_gives_the_stored_key_and_the_reference_finds_it() -> None:
    files = find_pack(7)
    found = measured(files, 2)
    subject = Subject.open(files)
    assert (found["engine"], found["right"]) == (version("mujoco"), True)
    assert subject.agrees(found["keys"][0], subject.truth(subject.draw(0)), 0.01)
    assert row_of("9.9", [found], {7: found}, 60.0).cells()[2:] == ["1 of 1", "0", "1"]


@pytest.mark.parametrize(("keys", "same"), [([10.12], True), ([10.13], False), ([], False)])
def test_a_key_may_depend_on_the_engine_by_a_quarter_of_the_tolerance(keys: list[float], same: bool) -> None:
    """The tolerance of scene 7 is 5 %, so a key of 10 may change to 10.125."""
    assert (other_key(Subject.open(find_pack(7)), [10.0], keys) == "") == same


def test_a_word_is_the_same_or_another() -> None:
    subject = Subject.open(find_pack(8))
    assert other_key(subject, ["object_1", "object_2"], ["object_1", "object_2"]) == ""
    assert other_key(subject, ["object_1", "object_2"], ["object_1", "0"]) == "seed 1: 0 instead of object_2"


def test_a_scene_that_an_engine_cannot_play_is_told_with_its_reason() -> None:
    found = measured(find_pack(7), 1)
    broken = found | {"keys": [], "right": False, "why": "AttributeError('detach_body')"}
    row = row_of("9.9", [broken], {7: found}, 0.0)
    assert (row.wrong, row.other_keys) == ({7: broken["why"]}, {7: "the engine gives no key"})
