"""Tests of `tests.harness.evidence`: the printed comparison of errors with bounds, and the reuse of stored episodes."""

import json
from pathlib import Path

import pytest

from scenes import find_pack, pack_hash
from tests.harness.evidence import Measured, errors_of, kept, table


def episode(scene: int, *errors: float, pack: str = "a", why: str = "") -> Measured:
    return {"pack": pack, "scene": scene, "seed": 1, "right": True, "errors": list(errors), "why": why}


def test_scenes_whose_errors_are_not_of_the_size_of_their_bounds_are_listed() -> None:
    found = [episode(1, 1.0, -1.0), episode(2, 0.5), episode(3, 3.0, 4.0), episode(4, why="a formula")]
    *_, first, second, third, fourth, last = table(found)
    assert first.split()[3] == "1.00"
    assert second.split()[3] == "0.50"
    assert float(third.split()[3]) == pytest.approx(3.54, abs=0.01)
    assert fourth.endswith("not measurable: a formula")
    assert last == "1 of 3 scenes between 0.85 and 1.5; others: [2, 3]"


def test_episodes_of_changed_packs_are_played_again(tmp_path: Path) -> None:
    file = tmp_path / "episodes.jsonl"
    file.write_text("".join(json.dumps(episode(1, 1.0, pack=pack)) + "\n" for pack in ("old", "new")))
    assert [one["pack"] for one in kept(file, {1: "new"})] == ["new"]


def test_the_error_of_a_reference_is_divided_by_its_bound() -> None:
    files = find_pack(7)
    found = errors_of(files, 1)
    assert found["right"]
    assert found["pack"] == pack_hash(files)
    assert len(found["errors"]) == 1
