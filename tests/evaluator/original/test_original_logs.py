"""Tests of reading and replaying the published logs, with generated logs of the same format."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from pydantic import JsonValue

from evaluator.answers.keys import KeyRing
from evaluator.commands.program import main
from evaluator.errors import UsageError
from evaluator.original.logs import LoggedVerdict, find_logs
from evaluator.original.play import Disagreement, Eq1Disagreement, eq1, scene_of, why_other_than_eq1, why_other_verdict
from evaluator.store.run_folder import RunFolder
from scenes import default_folder

SCENES = default_folder()
TITLE = KeyRing().facts(7).name
KEY = KeyRing().key(7, 0).value
LOOK = '[{"tool": "get_position", "parameters": {"object_id": "object_1"}}]'


def write_log(
    folder: Path,
    replies: list[str],
    *,
    verdict: tuple[str, str, bool] | None = None,
    unread: tuple[int, ...] = (),
    history: int | None = None,
    title: str = TITLE,
    stamp: str = "20260101T000000",
) -> Path:
    """Write a log in the format of the authors' program; without a verdict it ends as after a crash."""
    text = "=== Experiment Log for 7 ===\n\n"
    for number, reply in enumerate(replies, start=1):
        said = "Previous results: Error: Invalid JSON syntax for tool(s)." if number - 1 in unread else "What next?"
        prompt = f"Some task.\n\nScene Description: {title}.\nTask: find out." if number == 1 else said
        text += f"\n--- Iteration {number} ---\nLLM Input Prompt Below:\n{prompt}\n\nLLM Response Below:\n{reply}\n"
    final = ""
    if verdict:
        answer, key, right = verdict
        final = f"\n=== Final Experiment Summary ===\n\n--- Final Answer Submitted ---\nLLM's Final Answer: {answer}\n"
        final += f"Correct Answer: {key}\nIs Correct: {right}\nAnswer Found: True\nTimeout Occurred: False\n"
        count = len(replies) if history is None else history
        entries = "".join(f"  [{number}] []\n" for number in range(1, count + 1))
        final += f"\n--- Tool Call History ---\n{entries}\n--- Tool Call Results ---\n  [1] {{}}\n"
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"summary_{stamp}.txt"
    path.write_bytes(text.encode() + final.encode("cp1252"))
    return path


def answer(value: object) -> str:
    return f'It is {value}.\n\n[{{"tool": "answer", "parameters": {{"answer": "{value}"}}}}]'


def test_a_log_is_split_into_turns(tmp_path: Path) -> None:
    folder = tmp_path / "iterations_05" / "some_model" / "scene_007"
    reply = f"The angle θ is small.\n\n--- Iteration 2 ---\n is what I would see next.\n{LOOK}"
    write_log(folder, [reply, "", answer("±3")], verdict=("±3 m", "3", False), history=2)
    write_log(folder, [LOOK, "[1, 2]"], unread=(1,), stamp="20260102T000000")
    first, second = find_logs(tmp_path)
    assert first.replies == (reply, "", answer("±3"))
    assert (first.model, first.budget, first.scene, first.scene_name) == ("some_model", 5, 7, TITLE)
    assert first.verdict == LoggedVerdict("±3 m", "3", right=False)
    assert (first.read, first.finished, first.crashed) == (2, True, False)
    assert (second.verdict, second.read, second.finished, second.crashed) == (None, 0, False, True)


def test_the_budget_comes_from_the_folder_the_summary_or_the_second_prompt(tmp_path: Path) -> None:
    path = write_log(tmp_path / "m" / "scene_007", [LOOK, LOOK])
    assert find_logs(tmp_path)[0].budget == 0
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace("What next?", "You have 8 iterations remaining to answer."), encoding="utf-8")
    assert find_logs(tmp_path)[0].budget == 10
    path.with_name("log_20260101T000000.json").write_text('[{"summary": {"Iterations Given": 15}}]', encoding="utf-8")
    assert find_logs(tmp_path)[0].budget == 15
    (tmp_path / "m").rename(tmp_path / "iterations_20")
    assert find_logs(tmp_path)[0].budget == 20


def test_a_folder_without_logs_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="holds no logs"):
        find_logs(tmp_path)


def test_a_log_in_the_wrong_folder_is_recognised_by_its_title(tmp_path: Path) -> None:
    write_log(tmp_path / "m" / "scene_007", [LOOK], title="Another Title")
    [log] = find_logs(tmp_path)
    assert scene_of(log, {7: "A", 13: "Another Title"}) == 13
    assert scene_of(log, {7: "Another Title", 13: "Another Title"}) == 7
    assert scene_of(log, {7: "A", 12: "Another Title", 13: "Another Title"}) == 7
    assert scene_of(log, {8: "A"}) is None
    assert scene_of(replace(log, scene_name=""), {7: "A"}) == 7


@pytest.mark.parametrize(
    ("given", "key", "right"),
    [
        ("10.5", 10, True),
        ("10.6", 10, False),
        ("-9.5", -10, True),
        ("9.5", -10, False),
        ("[5, 9.886]", [5, 10], True),
        ("5 9.886", [5, 10], True),
        ("5", [5, 10], False),
        (0, 0, True),
        (0.001, 0, False),
        ("clockwise", 2, None),
        ("2 kg", 2, None),
        ("nan", 2, None),
        ("", 2, None),
    ],
)
def test_eq_1_applies_only_to_numbers(given: JsonValue, key: JsonValue, right: bool | None) -> None:
    assert eq1(given, key) is right


@pytest.mark.parametrize(
    ("logged", "answered", "key", "strict", "normalised", "why"),
    [
        (("2", "2", True), "2", 2, True, True, None),
        (("3", "2", False), 3, 2, False, False, None),
        (("0.72", "0.72", False), 0.72, 0.72, True, True, Disagreement.SAME_TEXT),
        (("63.435", "63.4", False), "63.435", 63.4, True, True, Disagreement.TOLERANCE),
        (("object_2", "2", False), "object_2", 2, False, True, Disagreement.FORM),
        (("object_2", "2", True), "object_2", 2, False, True, Disagreement.FORGIVEN),
        (("it rolls", "rolls", False), "it rolls", "rolls", True, True, Disagreement.WORDING),
        (("-1.96", "1.96", True), -1.96, 1.96, False, False, Disagreement.SIGN),
        (("1", "1, 10", True), "1", [1, 10], False, False, Disagreement.PART),
        (("1,4", "1", True), "1,4", 1, False, False, Disagreement.MORE),
        (("0.587", "0.513", True), "0.587", 0.513, False, False, Disagreement.FAR),
        (("3.96", "22.9", True), "3.96", 22.9, False, False, Disagreement.OTHER_KEY),
        (("elastic", "2", True), "elastic", 2, False, False, Disagreement.WORDS),
        (("None", "2", False), "2", 2, True, True, Disagreement.OTHER_ANSWER),
        (("2", "2", True), None, 2, False, False, Disagreement.OTHER_ANSWER),
        (("[1, 2]", "1, 2", False), [1.0, 2], [1, 2], True, True, Disagreement.SAME_TEXT),
    ],
)
def test_each_disagreement_has_its_reason(
    logged: tuple[str, str, bool],
    answered: JsonValue,
    key: JsonValue,
    strict: bool,
    normalised: bool,
    why: Disagreement | None,
) -> None:
    verdict = LoggedVerdict(logged[0], logged[1], logged[2])
    assert why_other_verdict(verdict, answered, key, strict=strict, normalised=normalised) is why


def test_eq_1_and_the_strict_verdict_differ_on_choices_and_zero() -> None:
    assert why_other_than_eq1(True, True, 3, is_choice=True) is None
    assert why_other_than_eq1(True, False, 3, is_choice=True) is Eq1Disagreement.CHOICE
    assert why_other_than_eq1(False, True, [0, 2], is_choice=False) is Eq1Disagreement.ZERO
    assert why_other_than_eq1(True, False, 3, is_choice=False) is Eq1Disagreement.UNEXPLAINED


def test_the_command_plays_and_compares(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = tmp_path / "logs" / "iterations_05" / "some_model"
    bad = '[{"tool": "fly", "parameters": {}}, {"tool": "step", "parameters": {"duration": 0.1}}]'
    unknown = '[{"tool": "get_position", "parameters": {"object_id": "object_99"}}]'
    write_log(model / "scene_007", [LOOK, bad, unknown, answer(KEY)], verdict=(str(KEY), str(KEY), False))
    # The authors' program crashes on a call object without a list; our parser accepts it.
    write_log(model / "scene_008", [f"It stands at [0, 0, 1].\n{answer(KEY)[:-1].replace('[{', '{')}"])
    write_log(model / "scene_009", [], title="")
    write_log(model / "scene_010", ["I think.", "", "[{'tool': x}]"], verdict=("None", str(KEY), False), history=0)
    out = tmp_path / "tables.md"
    words = ["replay-original", str(tmp_path / "logs"), "--scenes-dir", str(SCENES), "--jobs", "2"]
    assert main([*words, "--json", "--out", str(out), "--keep", str(tmp_path / "kept")]) == 0
    said = json.loads(capsys.readouterr().out)
    [row] = said["rows"]
    assert said["left_out"] == {"no reply": 1, "no pack": 0}
    assert (row["episodes"], row["crashed"], row["crashed_readable"], row["not_played"]) == (3, 1, 1, 0)
    assert row["replies"] == {
        "replies": 8,
        "read_by_them": 4,
        "with_calls": 5,
        "empty": 1,
        "without_calls": 1,
        "malformed": 1,
    }
    assert row["calls"] == {"executed": 3, "refused": 1, "misfitting": 1, "not_run": 1}
    verdicts = row["verdicts"]
    assert (verdicts["logged"], verdicts["logged_right"], verdicts["strict_right"]) == (2, 0, 1)
    assert (verdicts["numeric"], verdicts["eq1_right"]) == (1, 1)
    assert (verdicts["unlogged"], verdicts["unlogged_answered"], verdicts["unlogged_strict_right"]) == (1, 1, 1)
    assert row["disagreements"] == {Disagreement.SAME_TEXT: 1}
    assert [disagreement["scene"] for disagreement in said["disagreements"]] == [7]
    assert f"| {Disagreement.SAME_TEXT} | 1 | 7 |" in out.read_text(encoding="utf-8")
    kept = RunFolder(tmp_path / "kept").episodes()
    assert {(key.agent, key.scene, key.budget, key.protocol) for key in kept} == {("some_model", 7, 5, "text")}
    # Three logs name the same scene.
    assert sorted((key.epoch, len(episode.turns)) for key, episode in kept.items()) == [(1, 4), (2, 1), (3, 3)]
    assert main([*words, "--limit", "1"]) == 0
    assert "| some_model | 5 | 1 | 4 | 0 | 4 (100.0%) |" in capsys.readouterr().out


def test_the_command_is_not_listed_but_explains_itself(capsys: pytest.CaptureFixture[str]) -> None:
    for words in (["--help"], ["replay-original", "--help"]):
        with pytest.raises(SystemExit, match="0"):
            main(words)
    listing, own = capsys.readouterr().out.split("usage: physment-eval replay-original", 1)
    assert "replay runs/mine" in listing
    assert "replay-original" not in listing
    assert "--as-logged" in own
