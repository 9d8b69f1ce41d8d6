"""Tests that the seal of a run reveals every change of its records, and reports records that it does not cover."""

from pathlib import Path

import pytest

from evaluator.commands.program import main
from evaluator.errors import StoreError
from evaluator.store.durable import Seal
from evaluator.store.run_folder import RunFolder
from evaluator.study.integrity import Sealing, seal_note

EDITS = {
    "an answer": lambda lines: [lines[0].replace(b'"outcome":"', b'"outcome": "', 1), *lines[1:]],
    "a line less at the end": lambda lines: lines[:-1],
    "a line less in the middle": lambda lines: [lines[0], *lines[2:]],
    "another order": lambda lines: [lines[1], lines[0], *lines[2:]],
    "a line twice": lambda lines: [lines[0], lines[0], *lines[2:]],
}


def played(folder: Path, host_url: str, *more: str) -> int:
    words = ["--server", host_url, "--agent", "random", "--scenes", "7", "--seeds", "0-2", "--out", str(folder)]
    return main([*words, "--concurrency", "1", *more])


def test_a_chain_depends_on_every_line_and_their_order() -> None:
    first = Seal().after(b"a").after(b"b")
    assert first.lines == 2
    assert first.head != Seal().after(b"b").after(b"a").head != Seal().after(b"ab").head
    assert first.problem([b"a", b"b"]) == first.problem([b"a", b"b", b"c"]) == ""
    assert first.problem([b"a"]) == "2 episodes were sealed, and 1 are there"
    assert first.problem([b"a", b"c"]) == "the sealed episodes have been changed"
    assert Seal().problem([]) == ""


def test_a_finished_run_is_sealed_and_the_seal_is_printed(
    tmp_path: Path, host_url: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert played(tmp_path / "run", host_url) == 0
    folder = RunFolder(tmp_path / "run")
    seal = folder.read_seal()
    assert seal is not None
    assert f"seal: 3 episodes, {seal.head}" in capsys.readouterr().out
    assert seal_note(folder) == f"3 sealed, {seal.head}"
    assert f"3 sealed, {seal.head}" in folder.report_file.read_text(encoding="utf-8")


@pytest.mark.parametrize("edit", EDITS)
def test_every_edit_is_found_by_grade_report_merge_and_resume(
    tmp_path: Path, host_url: str, capsys: pytest.CaptureFixture[str], edit: str
) -> None:
    folder = RunFolder(tmp_path / "run")
    assert played(folder.path, host_url) == 0
    lines = EDITS[edit](folder.episode_lines())
    folder.episodes_file.write_bytes(b"".join(line + b"\n" for line in lines))
    capsys.readouterr()
    out, merged = ["--out", str(tmp_path / "out")], ["--out", str(tmp_path / "merged")]
    commands = [["grade", str(folder.path)], ["merge", str(folder.path), *merged], ["report", str(folder.path), *out]]
    for words in commands:
        assert main(words) != 0
        assert "is not what the run wrote" in capsys.readouterr().err
    assert played(folder.path, host_url, "--resume") != 0
    assert "is not what the run wrote" in capsys.readouterr().err
    for words in commands:
        assert main([*words, "--allow-modified"]) == 0
    for page in (folder.report_file, tmp_path / "merged" / "report.html", tmp_path / "out" / "report.html"):
        assert "NOT as they were sealed" in page.read_text(encoding="utf-8")
    assert played(folder.path, host_url, "--resume", "--allow-modified") == 0
    seal = folder.read_seal()
    assert seal is not None
    assert len(seal.edited) == 1
    assert seal.edited[0] in seal_note(folder)


def test_a_line_that_was_forged_while_the_run_was_played_is_found(tmp_path: Path, host_url: str) -> None:
    assert played(tmp_path / "other", host_url) == 0
    forged = RunFolder(tmp_path / "other").episode_lines()[0]
    folder = RunFolder(tmp_path / "run")
    folder.create(resume=False)
    sealing = Sealing(folder)
    folder.episodes_file.write_bytes(forged + b"\n")  # by another program
    sealing.add(b"what the evaluator wrote")
    folder.write_seal(sealing.seal)
    with pytest.raises(StoreError, match="have been changed"):
        seal_note(folder)


def test_a_run_that_was_killed_is_continued_and_the_report_tells_what_was_not_sealed(
    tmp_path: Path, host_url: str
) -> None:
    folder = RunFolder(tmp_path / "run")
    assert played(folder.path, host_url) == 0
    folder.seal_file.unlink()
    folder.episodes_file.write_bytes(b"".join(line + b"\n" for line in folder.episode_lines()[:2]))
    assert "not sealed" in seal_note(folder)
    assert played(folder.path, host_url, "--resume") == 0
    seal = folder.read_seal()
    assert seal is not None
    assert (seal.lines, seal.found) == (3, 2)
    assert "2 of them were sealed as they were found" in seal_note(folder)


def test_a_seal_that_cannot_be_read_is_an_error(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path)
    folder.seal_file.write_text("{", encoding="utf-8")
    with pytest.raises(StoreError, match="is no seal of a run"):
        seal_note(folder)


@pytest.mark.parametrize("lost", [1, 2, 100])
def test_a_finished_run_whose_last_line_lost_its_end_plays_that_episode_again_and_says_so(
    tmp_path: Path, host_url: str, capsys: pytest.CaptureFixture[str], lost: int
) -> None:
    folder = RunFolder(tmp_path / "run")
    assert played(folder.path, host_url) == 0
    whole = folder.episodes()
    with folder.episodes_file.open("r+b") as stream:
        stream.truncate(folder.episodes_file.stat().st_size - lost)
    assert played(folder.path, host_url, "--resume") == 0
    assert "line 3 was damaged (its end is missing)" in capsys.readouterr().err
    assert {key: episode.answer for key, episode in folder.episodes().items()} == {
        key: episode.answer for key, episode in whole.items()
    }
    assert "its end is missing" in seal_note(folder)
