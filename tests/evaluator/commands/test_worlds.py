"""Tests of `physment-eval worlds`: it makes, resumes, shows and verifies worlds, and reports errors."""

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import cast

import pytest

from evaluator.certify.worlds import Made, Unmade
from evaluator.commands.program import main
from evaluator.records.episode import Verdict
from evaluator.store.durable import locked
from evaluator.store.run_folder import RunFolder
from physment_mcp.commands.program import main as laboratory
from scenes.world_names import scene_id_of
from scenes.worlds.records import keys_file, lines_file, read_certificates, read_records
from tests.builders.worlds import write_worlds


def test_worlds_are_made_resumed_shown_and_proved(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    make = ["worlds", "make", "--level", "1", "--out", str(tmp_path), "--workers", "1"]
    assert main([*make, "--count", "1"]) == 0
    first = lines_file(tmp_path, 1).read_text(encoding="utf-8")
    assert main([*make, "--count", "2"]) == 0
    assert "1 existed" in capsys.readouterr().out
    assert lines_file(tmp_path, 1).read_text(encoding="utf-8").startswith(first)
    assert [record.index for record in read_records(tmp_path, 1)] == [0, 1]
    assert main(["worlds", "show", "1:1", "--worlds-dir", str(tmp_path), "--private"]) == 0
    shown = capsys.readouterr().out
    assert "Find out enough to answer three questions" in shown
    assert "key=(" in shown
    assert main(["worlds", "verify", "--worlds-dir", str(tmp_path), "--workers", "1"]) == 0
    assert "2 of 2 worlds are sound" in capsys.readouterr().out
    keys = keys_file(tmp_path, 1).read_text(encoding="utf-8").splitlines()
    keys_file(tmp_path, 1).write_text(keys[0] + "\n", encoding="utf-8")
    assert main(["worlds", "verify", "--worlds-dir", str(tmp_path), "--workers", "1"]) == 1
    assert "world:1:1: no certificate" in capsys.readouterr().out


def test_a_world_is_named_where_a_scene_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    worlds = write_worlds(tmp_path / "w", (0, 1))
    folder = ["--scenes-dir", str(worlds)]
    assert main(["scenes", "show", "world:1:1", *folder]) == 0
    assert "Find out enough to answer three questions" in capsys.readouterr().out
    run = ["run", "--server", "host", "--agent", "blind", "--scenes", "world:1:0-1", "--out", str(tmp_path / "run")]
    assert main([*run, *folder]) == 0
    episodes = RunFolder(tmp_path / "run").episodes().values()
    assert sorted(episode.key.scene for episode in episodes) == [scene_id_of(1, 0), scene_id_of(1, 1)]
    assert main(["grade", str(tmp_path / "run"), *folder]) == 0
    reference = ["run", "--server", "host", "--agent", "reference", "--scenes", "world:1"]
    assert main([*reference, *folder, "--out", str(tmp_path / "reference")]) == 0
    grades = RunFolder(tmp_path / "reference").grades().values()
    assert [record.grade.strict for record in grades] == [Verdict.CORRECT] * 2
    assert laboratory(["export", str(tmp_path / "exported"), "--scenes", "world:1:0", "--seeds", "0", *folder]) == 0
    key = next(read_certificates(worlds, 1)).key
    texts = [path.read_text(encoding="utf-8") for path in (tmp_path / "exported").rglob("*") if path.is_file()]
    assert len(texts) == 2
    assert not any(f"{number:.5g}" in text for number in key for text in texts)
    capsys.readouterr()
    for wrong, sentence in (
        ("world:1:7", "there is no world:1:7; level 1 has 2 worlds here"),
        ("world:2", "there are no worlds of level 2 here"),
        ("world:11", "there is no level 11; levels are 1 to 10"),
        ("world:one", "names no worlds; write world:LEVEL:INDEX"),
        ("world:1:1-0", "a range goes from the smaller number to the larger one"),
    ):
        assert main([*run[:5], "--scenes", wrong, *folder]) == 2
        assert sentence in capsys.readouterr().err


def test_show_without_a_folder_prints_a_published_world(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["worlds", "show", "5:1"]) == 0
    text = capsys.readouterr().out
    assert text.startswith("A puck, object_1, whose mass you are not told")
    assert "centre screened" not in text


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["make", "--level", "11", "--out", "w"], "11 is not a level from 1 to 10"),
        (["make", "--level", "2", "--out", "w", "--set", "terms=9"], "terms must be from 1 to 6, not 9"),
        (["make", "--level", "2", "--out", "w", "--set", "terms"], "write NAME=VALUE"),
        (["make", "--level", "2", "--out", "w", "--set", "terms=2.5"], "terms=2.5: write NAME=VALUE"),
        (["make", "--level", "2", "--out", "w", "--set", "kinds=3"], "kinds must be some of strong, far, late"),
        (["make", "--level", "2", "--out", "w", "--set", "apparatuses=car"], "apparatuses=car: write NAME=VALUE"),
        (["make", "--level", "1", "--out", "w", "--set", "modulations=6"], "draws of parts meets these attributes"),
        (["make", "--level", "1", "--out", "w", "--key-file", "none"], "--key-file none: No such file or directory"),
        (["make", "--level", "3-2", "--out", "w"], "a range goes from the smaller level to the larger one"),
        (["make", "--level", "1", "--out", "w", "--first", "100000"], "from 0 to 99999"),
        (["make", "--level", "1", "--out", "w", "--first", "99999", "--count", "2"], "has 1 such worlds from 99999 on"),
        (["make", "--level", "1", "--out", "w", "--split", "held-back"], "the worlds of a key are those of the split"),
        (["show", "5", "--worlds-dir", "w"], "world:5 does not name one world"),
        (["show", "5:1", "--worlds-dir", "w"], "there are no worlds of level 5 here"),
        (["publish", "--worlds-dir", "w", "--out", "set"], "w holds no worlds"),
        (["verify", "--worlds-dir", "w"], "holds no worlds"),
    ],
)
def test_wrong_usage_is_said_in_a_sentence(
    words: list[str], sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "w").mkdir()
    assert main(["worlds", *words]) == 2
    errors = capsys.readouterr().err
    assert sentence in errors
    assert errors.count("\n") == 1


@pytest.mark.extended
def test_worlds_of_a_split_are_made_published_selected_and_exported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    worlds, folder = write_worlds(tmp_path / "w", (0, 1)), ["--scenes-dir", str(tmp_path / "w")]
    make = ["worlds", "make", "--level", "1", "--workers", "1", "--out", str(worlds)]
    assert main([*make, "--count", "3"]) == 0
    assert main([*make, "--count", "1", "--split", "test"]) == 0
    assert "1 world of level 1 made" in capsys.readouterr().out
    assert [record.split for record in read_records(worlds, 1)] == ["train"] * 3 + ["test"]
    assert main(["worlds", "publish", "--worlds-dir", str(worlds), "--out", str(tmp_path / "set"), "--count", "3"]) == 0
    assert "3 worlds of each of 1 levels" in capsys.readouterr().out
    assert main(["worlds", "verify", "--worlds-dir", str(tmp_path / "set"), "--workers", "1"]) == 0
    run = ["run", "--server", "host", "--agent", "blind", "--scenes", "world:1", "--workers", "1", *folder]
    assert main([*run, "--split", "test", "--out", str(tmp_path / "test")]) == 0
    record = RunFolder(tmp_path / "test").read_run()
    assert (record.plan.scenes, record.plan.seeds, record.plan.split) == ((scene_id_of(1, 8),), (0,), "test@1")
    assert main([*run, "--split", "train", "--seeds", "10000,10001", "--out", str(tmp_path / "train")]) == 0
    assert len(RunFolder(tmp_path / "train").episodes()) == 6
    exported = tmp_path / "exported"
    assert (
        laboratory(["export", str(exported), "--scenes", "world:1", "--split", "train", "--seeds", "0", *folder]) == 0
    )
    assert len(list(exported.iterdir())) == 3
    key = tmp_path / "key"
    key.write_text("5a" * 32, encoding="ascii")
    capsys.readouterr()
    for words, sentence in (
        ([*run, "--split", "validation"], "the split validation has none of the worlds --scenes world:1"),
        ([*run, "--split", "test-open"], "the split test-open has none of the worlds"),
        (
            [*run, "--seed-key", str(key)],
            "worlds are held back by the key that `worlds make",
        ),
        ([*make, "--count", "4", "--set", "looks=40"], "which was made with the settings of the level"),
        ([*make, "--count", "4", "--key-file", str(key)], "which was made with the settings of the level"),
    ):
        assert main(words) == 2
        assert sentence in capsys.readouterr().err, words


def test_seeds_of_a_world_are_other_noise(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    worlds = write_worlds(tmp_path / "w")
    folder = ["--scenes-dir", str(worlds)]
    shown: list[list[str]] = []
    for seed in ("0", "3", "3"):
        assert main(["scenes", "show", "world:1:0", "--seed", seed, "--private", *folder]) == 0
        shown.append(capsys.readouterr().out.splitlines())
    assert shown[1] == shown[2]
    assert "key at every seed" in "".join(shown[0])
    other = [line for line, now in zip(shown[0], shown[1], strict=True) if line != now]
    assert all(line.startswith("| object_") for line in other)  # only readings at the start differ
    out = tmp_path / "run"
    run = [
        "run",
        "--server",
        "host",
        "--agent",
        "reference",
        "--scenes",
        "world:1:0",
        "--seeds",
        "0-2",
        "--workers",
        "1",
    ]
    assert main([*run, "--out", str(out), *folder]) == 0
    episodes = RunFolder(out).episodes().values()
    assert len({str(episode.answer) for episode in episodes}) == 3
    assert len({str(grade.answer_key) for grade in RunFolder(out).grades().values()}) == 1


def test_two_processes_do_not_make_worlds_in_one_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    make = ["worlds", "make", "--level", "1", "--count", "1", "--workers", "1", "--out", str(tmp_path)]
    with locked(tmp_path):
        assert main(make) == 2
    assert "by another process; wait for its end, or choose another --out" in capsys.readouterr().err
    assert main(make) == 0


def test_a_kill_between_the_two_lines_of_a_world_loses_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    worlds = write_worlds(tmp_path / "w", (100, 101))
    lines = lines_file(worlds, 1).read_text(encoding="utf-8")
    lines_file(worlds, 1).write_text(lines.splitlines()[0] + "\n" + lines.splitlines()[1][:50], encoding="utf-8")
    make = ["worlds", "make", "--level", "1", "--first", "100", "--count", "2", "--workers", "1", "--out", str(worlds)]
    assert main(make) == 0
    assert lines_file(worlds, 1).read_text(encoding="utf-8") == lines
    assert main(["worlds", "verify", "--worlds-dir", str(worlds), "--workers", "1"]) == 0
    assert "2 of 2 worlds are sound" in capsys.readouterr().out


def test_a_world_that_cannot_be_made_does_not_stop_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    record = next(read_records(write_worlds(tmp_path / "one"), 1))
    certificate = next(read_certificates(tmp_path / "one", 1))

    async def make(*arguments: object) -> None:
        on_made = cast("Callable[[object], None]", arguments[-1])
        on_made(Made(record, certificate, Counter()))
        on_made(Unmade(1, "none of 400 draws was accepted"))

    monkeypatch.setattr("evaluator.certify.worlds.make_worlds", make)
    words = ["worlds", "make", "--level", "1", "--count", "2", "--workers", "1", "--out", str(tmp_path / "w")]
    assert main(words) == 1
    assert "world:1:1: none of 400 draws was accepted" in capsys.readouterr().err
    assert [one.index for one in read_records(tmp_path / "w", 1)] == [0]
