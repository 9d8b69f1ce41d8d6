"""Tests that run folders survive kills and report damage."""

from collections.abc import Callable
from pathlib import Path

import pytest

from evaluator.errors import StoreError
from evaluator.records.episode import Episode, Outcome
from evaluator.records.run import Plan, RunRecord, ServerRecord
from evaluator.store.run_folder import RunFolder
from evaluator.study.runner import missing
from tests.builders.records import episode, episode_key


def episode_of(scene: int, outcome: Outcome = Outcome.ANSWERED, prompt: str = "") -> Episode:
    return episode(key=episode_key(scene, budget=5), outcome=outcome, prompt=prompt)


def record() -> RunRecord:
    plan = Plan(scenes=(7,), agents=("x",))
    return RunRecord(created_at="2026-01-01T00:00:00+00:00", plan=plan, server=ServerRecord(option="host"))


@pytest.fixture
def folder(tmp_path: Path) -> RunFolder:
    made = RunFolder(tmp_path / "run")
    made.create(resume=False)
    return made


def test_what_was_appended_is_read_back(folder: RunFolder) -> None:
    for scene in (7, 8):
        folder.append_episode(episode_of(scene, prompt="an eä\nb"))
    assert [key.scene for key in folder.episodes()] == [7, 8]
    assert folder.episodes()[episode_of(7).key].prompt == "an eä\nb"


@pytest.mark.parametrize("kept", [0.1, 0.5, 0.99])
def test_an_unfinished_last_line_is_moved_aside_and_the_rest_is_kept(folder: RunFolder, kept: float) -> None:
    for scene in (7, 8, 9):
        folder.append_episode(episode_of(scene, prompt="äöü" * 50))
    content = folder.episodes_file.read_bytes()
    last = content.rindex(b"\n", 0, len(content) - 1) + 1
    torn = content[: last + max(1, int((len(content) - 1 - last) * kept))]
    folder.episodes_file.write_bytes(torn)
    assert [key.scene for key in folder.episodes()] == [7, 8]
    # Another process may still be writing this line, so reading leaves it. Appending the next line moves it aside.
    assert folder.episodes_file.read_bytes() == torn
    folder.append_episode(episode_of(9))
    assert [key.scene for key in folder.episodes()] == [7, 8, 9]
    assert folder.episodes_file.read_bytes().startswith(content[:last])
    assert folder.episodes_file.with_name("episodes.jsonl.torn").read_bytes() == torn[last:] + b"\n"


def test_a_damaged_line_in_the_middle_is_reported_with_its_number(folder: RunFolder) -> None:
    folder.append_episode(episode_of(7))
    with folder.episodes_file.open("a", encoding="utf-8") as stream:
        stream.write("{not json}\n")
    folder.append_episode(episode_of(8))
    with pytest.raises(StoreError, match=r"episodes\.jsonl, line 2 is damaged"):
        folder.episodes()


@pytest.mark.parametrize("damage", [b"{not json}", b"\xff\xfe", b"", b"[]"])
def test_damaged_lines_are_set_aside_and_their_episodes_are_missing(folder: RunFolder, damage: bytes) -> None:
    for scene in (7, 8, 9):
        folder.append_episode(episode_of(scene))
    first, _, last = folder.episodes_file.read_bytes().split(b"\n")[:-1]
    folder.episodes_file.write_bytes(b"\n".join([first, damage, last, b"{torn"]))
    (told,) = folder.set_damage_aside()
    assert "line 2 was damaged" in told
    assert "its episode is played again" in told
    assert [key.scene for key in folder.episodes()] == [7, 9]
    torn = folder.episodes_file.with_name("episodes.jsonl.torn")
    assert torn.read_bytes() == damage + b"\n"
    folder.append_episode(episode_of(8))  # moves the unfinished line aside, as always
    assert torn.read_bytes() == damage + b"\n{torn\n"
    assert [key.scene for key in folder.episodes()] == [7, 9, 8]
    assert folder.set_damage_aside() == []


def test_a_run_that_has_not_begun_has_no_damage(folder: RunFolder) -> None:
    assert folder.set_damage_aside() == []


@pytest.mark.parametrize("break_", ["\u2028", "\u2029", "\x85", "\x0b", "\x0c", "\x1c", "\r", "\r\n", "\0"], ids=ascii)
def test_unusual_line_breaks_in_a_record_do_not_end_its_line(folder: RunFolder, break_: str) -> None:
    for scene in (7, 8):
        folder.append_episode(episode_of(scene, prompt=f"one{break_}two"))
    assert [stored.prompt for stored in folder.episodes().values()] == [f"one{break_}two"] * 2


@pytest.mark.parametrize("damage", [b"\xff\xfe\n", b"\n", b"[]\n", b'{"format": 2}\n', b"[" * 300 + b"]" * 300 + b"\n"])
def test_every_kind_of_damage_is_reported_in_a_sentence_with_the_line(folder: RunFolder, damage: bytes) -> None:
    folder.append_episode(episode_of(7))
    with folder.episodes_file.open("ab") as stream:
        stream.write(damage)
    with pytest.raises(StoreError, match=r"episodes\.jsonl, line 2 is damaged"):
        folder.episodes()


def test_the_last_of_several_records_of_an_episode_counts(folder: RunFolder) -> None:
    folder.append_episode(episode_of(7, Outcome.INFRASTRUCTURE_ERROR))
    folder.append_episode(episode_of(7))
    assert [stored.outcome for stored in folder.episodes().values()] == [Outcome.ANSWERED]


def test_a_folder_with_a_run_can_only_be_resumed(folder: RunFolder) -> None:
    folder.write_run(record())
    with pytest.raises(StoreError, match="holds a run already; add --resume"):
        folder.create(resume=False)
    folder.create(resume=True)


def test_a_run_is_played_by_one_process_at_a_time(folder: RunFolder) -> None:
    with folder.held(), pytest.raises(StoreError, match="is being played by another process"), folder.held():
        pytest.fail("two would play the same episodes")
    with folder.held():
        assert list(folder.path.iterdir()) == []  # so that a folder whose run never began can be removed


def test_a_folder_that_cannot_be_made_is_refused_in_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(StoreError, match="cannot be written"):
        RunFolder(tmp_path / "file" / "run").create(resume=False)


def test_a_folder_without_a_run_is_refused(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="is not a run folder"):
        RunFolder(tmp_path).read_run()


@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("run.json", RunFolder.read_run),
        ("seal.json", RunFolder.read_seal),
        ("episodes.jsonl", RunFolder.episodes),
        ("episodes.jsonl", RunFolder.episode_lines),
        ("episodes.jsonl", RunFolder.set_damage_aside),
        ("grades.jsonl", RunFolder.grades),
    ],
)
def test_a_file_that_cannot_be_read_is_named_with_the_reason_and_without_the_words_of_python(
    folder: RunFolder, name: str, read: Callable[[RunFolder], object]
) -> None:
    (folder.path / name).mkdir()
    with pytest.raises(StoreError, match="Is a directory") as refused:
        read(folder)
    assert "Errno" not in str(refused.value)
    assert name in str(refused.value)


def test_a_seal_that_is_none_is_refused_with_its_first_problem(folder: RunFolder) -> None:
    folder.seal_file.write_text('{"a": 1}', encoding="utf-8")
    with pytest.raises(StoreError, match=r"seal\.json is no seal of a run: \w+: [^\n]+$"):
        folder.read_seal()


def test_a_run_file_with_a_missing_field_is_refused_with_its_name(folder: RunFolder) -> None:
    folder.run_file.write_text('{"created_at": "2026-01-01", "plan": {"scenes": [7]}}', encoding="utf-8")
    with pytest.raises(StoreError, match=r"run\.json cannot be read \(plan\.agents: Field required\)"):
        folder.read_run()


def test_missing_episodes_and_infrastructure_errors_are_still_to_be_played() -> None:
    plan = Plan(scenes=(7, 8, 9), agents=("x",), budgets=(5,))
    done = {stored.key: stored for stored in (episode_of(7), episode_of(8, Outcome.INFRASTRUCTURE_ERROR))}
    assert [key.scene for key in missing(plan.matrix(), done)] == [8, 9]


def test_a_matrix_holds_every_combination_once() -> None:
    keys = Plan(scenes=(7, 8), agents=("x",), budgets=(5, 10), seeds=(0, 1, 2), epochs=2).matrix()
    assert len(keys) == len(set(keys)) == 2 * 2 * 3 * 2
