"""Tests of the difficulties that lists and pages of scenes state."""

import json
from pathlib import Path

import pytest

from evaluator.calibration.adaptive import DIFFICULTIES, StatedDifficulty, read_calibration, stated_difficulties
from evaluator.errors import UsageError
from scenes import find_pack


@pytest.mark.parametrize(
    ("logits", "se", "word"),
    [
        (-2.4, 0.6, "far easier"),
        (-1.6, 0.6, "easier"),
        (1.9, 0.8, "harder"),
        (2.0, 0.9, "far harder"),
        (2.5, 1.4, "average or harder"),
        (-0.2, 0.7, "average or easier"),
    ],
)
def test_the_word_does_not_claim_what_the_error_leaves_open(logits: float, se: float, word: str) -> None:
    stated = StatedDifficulty(logits, se, right=3, answers=9, takers=17)
    assert stated.word == word
    assert "9 answers (3 right)" in stated.sentence


def test_a_changed_pack_has_no_difficulty(tmp_path: Path) -> None:
    content = json.loads(DIFFICULTIES.read_text(encoding="utf-8"))
    for one in content["scenes"]:
        if one["scene"] == 8:
            one["pack"] = "0" * 64
    file = tmp_path / "calibration.json"
    file.write_text(json.dumps(content), encoding="utf-8")
    packs = [find_pack(scene) for scene in (7, 8, 201)]
    assert list(stated_difficulties(packs, file)) == [7]
    file.write_text("{}", encoding="utf-8")
    with pytest.raises(UsageError, match="cannot be read as a calibration"):
        stated_difficulties(packs, file)


def test_the_takers_of_the_shipped_calibration_are_simulated_as_pages_say() -> None:
    simulated = ("taker:", "attacker:", "batch", "constant", "blind", "random")
    assert [one.name for one in read_calibration().takers if not one.name.startswith(simulated)] == []
