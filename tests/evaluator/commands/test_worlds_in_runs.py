"""Tests that runs of worlds are resumed, sharded, replayed, filmed, forked and reported with the same worlds only."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from evaluator.commands.program import main
from evaluator.records.episode import Verdict
from evaluator.store.run_folder import RunFolder
from scenes.worlds.folders import find_record
from scenes.worlds.records import lines_file
from tests.builders.worlds import write_worlds

Made = Callable[..., Path]
"""Returns a folder with two worlds of level 1, made with further options of `worlds make`."""


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:  # pyright: ignore[reportUnusedFunction] - pytest uses it
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.fixture(scope="module")
def make(tmp_path_factory: pytest.TempPathFactory) -> Made:
    kept: dict[tuple[str, ...], Path] = {(): write_worlds(tmp_path_factory.mktemp("worlds"), (0, 1))}

    def made(*options: str) -> Path:
        if options not in kept:
            kept[options] = tmp_path_factory.mktemp("worlds")
            command = ["worlds", "make", "--level", "1", "--count", "2", "--workers", "1", "--out", str(kept[options])]
            assert main([*command, *options]) == 0
        return kept[options]

    return made


def _run(worlds: Path, out: Path, *options: str, agent: str = "reference") -> int:
    command = ["run", "--server", "host", "--agent", agent, "--scenes", "world:1", "--workers", "1"]
    return main([*command, "--scenes-dir", str(worlds), "--out", str(out), *options])


def test_a_run_of_worlds_is_resumed_replayed_filmed_forked_and_reported(
    make: Made, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    worlds, out = make(), tmp_path / "run"
    assert _run(worlds, out) == 0
    stored = json.loads((out / "run.json").read_text(encoding="utf-8"))["worlds"]
    assert [(name, one["grammar"], one["split"]) for name, one in stored.items()] == [
        ("world:1:0", 1, "train"),
        ("world:1:1", 1, "train"),
    ]
    assert not any("settings" in one or "commitment" in one for one in stored.values())
    lines = (out / "episodes.jsonl").read_bytes().splitlines(keepends=True)
    (out / "episodes.jsonl").write_bytes(lines[0])
    (out / "seal.json").unlink()
    assert _run(worlds, out, "--resume") == 0
    assert [record.grade.strict for record in RunFolder(out).grades().values()] == [Verdict.CORRECT] * 2
    folder = ["--scenes-dir", str(worlds)]
    capsys.readouterr()
    assert main(["replay", str(out), "--exact", *folder]) == 0
    assert "2 episodes the same, 0 differences" in capsys.readouterr().out
    assert main(["film", str(out), *folder]) == 0
    assert main(["grade", str(out), *folder]) == 0
    assert main(["report", str(out), *folder]) == 0
    assert "world:1:0" in (out / "report.html").read_text(encoding="utf-8")
    fork = ["fork", str(out), "--episode", "scene=world:1:1", "--turn", "2", "--agent", "blind"]
    assert main([*fork, "--out", str(tmp_path / "fork"), *folder]) == 0
    assert len(RunFolder(tmp_path / "fork").episodes()) == 1


@pytest.mark.extended
def test_shards_of_worlds_are_merged(make: Made, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    worlds, out = make(), tmp_path / "run"
    for shard in ("1/2", "2/2"):
        assert _run(worlds, out, "--shard", shard, "--epochs", "3", agent="blind") == 0
    assert main(["merge", str(out), "--out", str(tmp_path / "whole"), "--scenes-dir", str(worlds)]) == 0
    assert len(RunFolder(tmp_path / "whole").episodes()) == 6
    capsys.readouterr()
    assert main(["merge", str(out), "--out", str(tmp_path / "other"), "--scenes-dir", str(tmp_path)]) == 2
    assert "there are no worlds of level 1 here" in capsys.readouterr().err


@pytest.mark.extended
def test_worlds_that_were_made_otherwise_are_refused(
    make: Made, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    key = tmp_path / "key"
    key.write_text("5a" * 32, encoding="ascii")
    worlds, others, keyed = make(), make("--set", "looks=40"), make("--key-file", str(key))
    out, shards = tmp_path / "run", tmp_path / "shards"
    assert _run(worlds, out, agent="blind") == 0
    for shard, folder in (("1/2", worlds), ("2/2", others)):
        assert _run(folder, shards, "--shard", shard, agent="blind") == 0
    reworded = tmp_path / "reworded"
    reworded.mkdir()
    lines_file(reworded, 1).write_text(
        lines_file(worlds, 1).read_text(encoding="utf-8").replace('"salt":"', '"salt":"0')
    )
    folder = ["--scenes-dir", str(others)]
    commands = [
        ["replay", str(out), *folder],
        ["film", str(out), *folder],
        ["grade", str(out), *folder],
        # `report` is not refused: it finds the same world, world:1:0, in the public set.
        ["fork", str(out), "--episode", "seed=0", "--turn", "1", "--agent", "random", *folder],
    ]
    settings = "world:1:0 was made with the settings of its level for the run, and the one here with looks=40"
    capsys.readouterr()
    for command in commands:
        assert main(command) == 2
        errors = capsys.readouterr().err
        assert settings in errors, command
        assert errors.count("\n") == 1
    assert _run(others, out, "--resume", agent="blind") == 2
    assert settings in capsys.readouterr().err
    assert main(["merge", str(shards), "--out", str(tmp_path / "whole"), "--scenes-dir", str(worlds)]) == 2
    assert "has other worlds than" in capsys.readouterr().err
    assert _run(keyed, out, "--resume", agent="blind") == 2
    assert "was made without a key for the run, and the one here with the key of commitment" in capsys.readouterr().err
    assert main(["replay", str(out), "--scenes-dir", str(reworded)]) == 2
    assert "was made as record" in capsys.readouterr().err


def test_keys_and_laws_of_held_back_worlds_are_in_no_record(make: Made, tmp_path: Path) -> None:
    key, out = tmp_path / "key", tmp_path / "run"
    key.write_text("5a" * 32, encoding="ascii")
    worlds = make("--key-file", str(key))
    assert _run(worlds, out, agent="blind") == 0
    grades = RunFolder(out).grades().values()
    assert {record.grade.strict for record in grades} == {Verdict.INCORRECT}
    assert not any(record.answer_key for record in grades)
    assert {record.grade.reason for record in grades} == {"withheld until the seeds are revealed"}
    solved = tmp_path / "solved"
    assert _run(worlds, solved, agent="taker:calls-12") == 0  # its few readings leave rivals
    bare = tmp_path / "bare"  # the run of another program, which writes no run.json
    bare.mkdir()
    (bare / "episodes.jsonl").write_bytes((solved / "episodes.jsonl").read_bytes())
    for folder in (solved, bare):
        assert main(["evidence", str(folder), "--scenes-dir", str(worlds), "--workers", "1"]) == 0
        for found in RunFolder(folder).evidence().values():
            assert found.calls
            assert found.rivals
            assert [rival.name for rival in found.rivals] == [f"rival {n}" for n in range(1, len(found.rivals) + 1)]
        text = RunFolder(folder).evidence_file.read_text(encoding="utf-8")
        assert not any(form in text for index in (0, 1) for form, _ in find_record(1, index, worlds).terms)
