# The optional library is not in the environment in which types are checked.
# pyright: reportMissingImports=false
"""Tests that the Parquet file of a run contains every exchange, and that another program can read it."""

import json
from importlib.util import find_spec
from pathlib import Path

import pytest

from evaluator.commands.program import main
from evaluator.records.episode import Episode, GradeRecord, LawGrade
from evaluator.records.run import RunRecord
from evaluator.report.parquet import COLUMNS, exchange_rows
from evaluator.store.run_folder import RunFolder
from tests.builders.records import WRONG, episode, episode_key, refused, returned, skipped, turn

needs_pyarrow = pytest.mark.skipif(
    find_spec("pyarrow") is None, reason="pyarrow, the extra `parquet`, is not installed"
)


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory, host_url: str) -> RunFolder:
    folder = tmp_path_factory.mktemp("parquet") / "run"
    assert main(["run", "--agent", "random", "--scenes", "7,8", "--server", host_url, "--out", str(folder)]) == 0
    return RunFolder(folder)


def test_a_row_holds_its_episode_its_turn_and_its_exchange() -> None:
    played = episode(
        turn("I look.", returned("get_position", {"sim_time": 0.5, "position": [0, 0, 1]}, object_id="object_1")),
        turn("no call"),
        turn("", refused("step", "too long", duration=9), skipped("step", duration=1)),
        answer=[1, "m"],
    )
    graded = GradeRecord(key=played.key, grade=WRONG, answer_key=1, grader_version="3", pack_version="0")
    first, second, third = exchange_rows(played, graded)
    assert set(first) == set(COLUMNS)
    assert (first["scene"], first["strict"], first["graded"], first["answer"]) == (7, "incorrect", 0.0, '[1,"m"]')
    assert (first["turn"], first["call"], first["reasoning"], first["sim_time"]) == (1, 1, "I look.", 0.5)
    assert json.loads(first["content"]) == {"sim_time": 0.5, "position": [0, 0, 1]}
    assert json.loads(first["arguments"]) == {"object_id": "object_1"}
    assert (first["reference"], first["law_equivalent"]) == ("7", None)
    assert (second["turn"], second["is_error"], second["content"], second["sim_time"]) == (3, True, None, None)
    assert (third["call"], third["returned"]) == (2, False)


def test_a_row_names_a_world_as_scenes_does_and_has_the_verdict_on_its_law() -> None:
    key = episode_key(10_500_003)
    played = episode(turn("", returned("step", {}, duration=1)), key=key)
    law = LawGrade(version="3", sha256="0", equivalent=True)
    record = GradeRecord(key=key, grade=WRONG, answer_key=1, grader_version="3", pack_version="0", law=law)
    (row,) = exchange_rows(played, record)
    assert (row["reference"], row["law_equivalent"]) == ("world:5:3", True)


@needs_pyarrow
def test_the_file_is_read_back_with_every_exchange(
    played: RunFolder, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from pyarrow import parquet

    file = tmp_path / "new" / "run.parquet"
    capsys.readouterr()
    assert main(["export", str(played.path), "--to", "parquet", "--out", str(file)]) == 0
    table = parquet.read_table(file)
    rows = table.to_pylist()
    exchanges = [
        (one.key.scene, exchange)
        for one in played.episodes().values()
        for played_turn in one.turns
        for exchange in played_turn.exchanges
    ]
    assert f"{len(exchanges)} exchanges" in capsys.readouterr().out
    assert table.column_names == list(COLUMNS)
    assert [(row["scene"], row["tool"], row["text"]) for row in rows] == [
        (scene, exchange.call.tool, exchange.text) for scene, exchange in exchanges
    ]
    assert [json.loads(row["arguments"]) for row in rows] == [exchange.call.arguments for _, exchange in exchanges]
    assert RunRecord.model_validate_json(table.schema.metadata[b"physment_run"]) == played.read_run()
    assert list(file.parent.iterdir()) == [file]


@pytest.mark.parametrize(
    ("form", "package", "install"),
    [("parquet", "pyarrow", "'physment-mcp[parquet]'"), ("inspect", "physment_inspect", "./integrations/inspect")],
)
def test_what_a_format_needs_is_named(
    played: RunFolder, form: str, package: str, install: str, capsys: pytest.CaptureFixture[str]
) -> None:
    if find_spec(package) is not None:
        pytest.skip(f"{package} is installed here")
    capsys.readouterr()
    assert main(["export", str(played.path), "--to", form]) == 2
    said = capsys.readouterr().err
    assert f"pip install {install}" in said
    assert said.count("\n") == 1


def test_an_ungraded_run_is_not_exported(tmp_path: Path, played: RunFolder, capsys: pytest.CaptureFixture[str]) -> None:
    folder = RunFolder(tmp_path / "run")
    folder.create(resume=False)
    folder.write_run(played.read_run())
    one: Episode = next(iter(played.episodes().values()))
    folder.append_episode(one)
    capsys.readouterr()
    assert main(["export", str(folder.path), "--to", "parquet"]) == 2
    assert "not every episode is graded" in capsys.readouterr().err
