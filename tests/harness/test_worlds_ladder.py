"""The worlds ladder writes each measurement as a line, resumes an interrupted run, and prints shares as a table."""

import json
import sys
from pathlib import Path

import pytest

from evaluator.certify.worlds import make_world
from scenes.worlds.catalogue import FORMS
from scenes.worlds.levels import difficulty_of
from scenes.worlds.orders import PUBLIC
from scenes.worlds.records import as_line, keys_file, lines_file
from tests.harness.worlds_ladder import LINEAR, REFERENCES, main, table


@pytest.mark.extended
def test_the_ladder_is_measured_and_resumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made = make_world(2, difficulty_of(2), PUBLIC, 0)
    lines_file(tmp_path, 2).write_text(as_line(made.record) + "\n", encoding="utf-8")
    keys_file(tmp_path, 2).write_text(as_line(made.certificate) + "\n", encoding="utf-8")
    out = tmp_path / "ladder.jsonl"
    words = ["ladder", "--worlds-dir", str(tmp_path), "--references", "informed", "one unknown", "--out", str(out)]
    monkeypatch.setattr(sys, "argv", words)
    assert main() == 0
    first = out.read_text(encoding="utf-8")
    found = [json.loads(line) for line in first.splitlines()]
    assert [line["reference"] for line in found] == ["informed", "one unknown"]
    assert found[0]["right"] == [True] * 3
    assert found[0]["known"]
    out.write_text(first + '{"level": 2, "ind', encoding="utf-8")  # cut off by a kill
    assert table(json.loads(line) for line in first.splitlines()) in capsys.readouterr().out
    assert main() == 0
    assert capsys.readouterr().err == ""  # nothing was measured again


def test_a_table_counts_worlds_that_are_right_in_all_answers() -> None:
    line = {"level": 3, "reference": "full", "covered": [True, True, False], "known": True, "seconds": 4.0}
    rows = table([line | {"right": [True] * 3}, line | {"right": [True, False, True], "known": False}])
    assert rows.splitlines()[-1] == "| 3 | 1/2 | 4/6 | 1/1 | 4 |"


def test_the_handicapped_references_are_those_of_the_grammar() -> None:
    assert set(FORMS) >= LINEAR
    assert {"informed", "full", "linear"} <= set(REFERENCES)
