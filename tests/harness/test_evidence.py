"""Tests of `tests.harness.evidence`: the printed comparison of errors with bounds, and the reuse of stored episodes."""

import json
from pathlib import Path

import anyio
import numpy as np
import pytest

from evaluator.certify.information import Information
from evaluator.certify.probing import Read
from evaluator.certify.subject import Subject
from scenes import find_pack, pack_hash
from tests.harness.evidence import Measured, OwnNoise, errors_of, kept, linear_errors, table


def episode(scene: int, *errors: float, pack: str = "a", why: str = "") -> Measured:
    return {"pack": pack, "scene": scene, "seed": 1, "right": True, "errors": list(errors),
            "linear": [0.5 * error for error in errors], "why": why}  # fmt: skip


def test_scenes_whose_errors_are_not_of_the_size_of_their_bounds_are_listed() -> None:
    found = [episode(1, 1.0, -1.0), episode(2, 0.5), episode(3, 3.0, 4.0), episode(4, why="a formula")]
    *_, first, second, third, fourth, last = table(found)
    assert first.split()[3] == "1.00"
    assert first.split()[6] == "0.50"
    assert second.split()[3] == "0.50"
    assert float(third.split()[3]) == pytest.approx(3.54, abs=0.01)
    assert fourth.endswith("not measurable: a formula")
    assert last == "1 of 3 scenes between 0.85 and 1.5; others: [2, 3]"


def test_episodes_of_changed_packs_are_played_again(tmp_path: Path) -> None:
    file = tmp_path / "episodes.jsonl"
    file.write_text("".join(json.dumps(episode(1, 1.0, pack=pack)) + "\n" for pack in ("old", "new")))
    assert [one["pack"] for one in kept(file, {1: "new"})] == ["new"]


def test_episodes_with_common_noise_are_played_again(tmp_path: Path) -> None:
    file = tmp_path / "episodes.jsonl"
    old = {name: value for name, value in episode(1, 1.0).items() if name != "linear"}
    file.write_text(json.dumps(old) + "\n")
    assert kept(file, {1: "a"}) == []


def test_each_seed_has_noise_of_its_own() -> None:
    """The hull rests at x = 0 at the start of every seed."""
    subject = Subject.open(find_pack(36))

    async def read(seed: int) -> object:
        async with OwnNoise(subject).open(36, seed) as client:
            return (await client.call_tool("get_position", {"object_id": "object_1"})).structured_content

    first, again, second = (anyio.run(read, seed) for seed in (1, 1, 2))
    assert first == again
    assert first != second


def test_the_linear_estimate_takes_its_share_of_an_error_of_a_reading() -> None:
    """One constant and one reading, whose standard deviation is a fifth of the range: F = 12 + 25."""
    reads = [Read(0, 0.0, np.array([1.0]), {(("velocity", "object_1", 0), 0): np.array([0.2])})]
    told = Information.of(reads, np.array([[1.0]]), np.array([False]))
    (error,) = linear_errors(np.array([[1 / np.sqrt(37)]]), told, np.array([1.2]))
    assert error == pytest.approx(0.2 * 25 / np.sqrt(37), rel=1e-6)


def test_the_error_of_a_reference_is_divided_by_its_bound() -> None:
    files = find_pack(7)
    found = errors_of(files, 1)
    assert found["right"]
    assert found["pack"] == pack_hash(files)
    assert len(found["errors"]) == 1
