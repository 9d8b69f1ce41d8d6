# The optional library is not in the environment in which types are checked.
# pyright: reportMissingImports=false
"""Tests of `export --to tasks`: the content of a row, that no scene is in two files, and that `test` has no
transcripts.
"""

import json
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest
import yaml

from evaluator.answers.keys import KeyRing
from evaluator.commands.program import main
from evaluator.referee.contract import WantedEpisode
from evaluator.referee.selection import variant_of
from evaluator.referee.tasks import COLUMNS, SPLITS
from scenes import CANARY
from scenes.splits import splits

TRAIN, TEST = 7, min({*splits()["test"].scenes} - {*splits()["validation"].scenes})


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("tasks") / "mine"
    asked = ["--scenes", f"{TRAIN},{TEST}", "--per-scene", "2"]
    assert main(["export", "--to", "tasks", "--out", str(out), *asked]) == 0
    return out


def rows(folder: Path, split: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / f"{split}.jsonl").read_text(encoding="utf-8").splitlines()]


def test_a_row_opens_its_variant_and_its_reference_solves_it(folder: Path) -> None:
    first, second = rows(folder, "train")
    assert first.keys() == COLUMNS.keys()
    assert first["id"] != second["id"]
    for row in (first, second):
        wanted = WantedEpisode(split=row["split"], index=row["index"])
        variant = variant_of(wanted, held_back=False)
        assert variant.scene == row["scene"] == TRAIN
        assert len(json.loads(row["tools"])) == 26
        *_, asked, told = json.loads(row["reference"])
        answer = json.loads(asked["tool_calls"][-1]["function"]["arguments"])["answer"]
        assert asked["tool_calls"][-1]["function"]["name"] == "answer"
        assert answer == pytest.approx(KeyRing().key(variant.scene, variant.seed).value, rel=0.05)
        assert told["tool_call_id"] == asked["tool_calls"][-1]["id"]
        assert json.loads(row["metadata"])["reference_calls"] == 3
        assert str(variant.seed) not in row["prompt"] + row["metadata"]


def test_a_row_of_the_test_has_no_reference(folder: Path) -> None:
    found = rows(folder, "test")
    assert [(row["scene"], row["reference"]) for row in found] == [(TEST, None)] * 2


def test_the_splits_share_no_scene_and_a_split_without_one_has_no_file(folder: Path) -> None:
    assert [(folder / f"{name}.jsonl").exists() for name in SPLITS] == [True, False, True]
    card = (folder / "README.md").read_text(encoding="utf-8")
    assert "validation" not in card.split("---")[1]
    assert "| train@1 | 1 | 2 |" in card
    assert CANARY in card


def test_a_data_set_with_the_test_split_declares_it_as_a_benchmark(folder: Path, tmp_path: Path) -> None:
    declared = yaml.safe_load((folder / "eval.yaml").read_text(encoding="utf-8"))
    (task,) = declared["tasks"]
    card = yaml.safe_load((folder / "README.md").read_text(encoding="utf-8").split("---")[1])
    (config,) = card["configs"]
    assert task["config"] == config["config_name"]
    assert task["split"] in {file["split"] for file in config["data_files"]}
    assert declared["evaluation_framework"] == "inspect-ai"
    assert main(["export", "--to", "tasks", "--out", str(tmp_path / "train"), "--scenes", str(TRAIN)]) == 0
    assert not (tmp_path / "train" / "eval.yaml").exists()


@pytest.mark.skipif(find_spec("pyarrow") is None, reason="pyarrow, the extra `parquet`, is not installed")
def test_the_parquet_file_holds_the_same_rows(folder: Path) -> None:
    from pyarrow import parquet

    assert parquet.read_table(folder / "train.parquet").to_pylist() == rows(folder, "train")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["export", "--to", "tasks"], "writes into the folder --out DIR"),
        (["export", "somewhere", "--to", "tasks", "--out", "x"], "takes no run folder"),
        (["export", "--to", "parquet"], "name a run folder"),
    ],
)
def test_what_cannot_be_exported_is_said(words: list[str], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(words) == 2
    assert says in capsys.readouterr().err
