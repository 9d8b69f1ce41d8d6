"""Tests of the conversion of logs to records: calls get the results that the models read. The logs are test data."""

from pathlib import Path

import pytest

from evaluator.answers.keys import KeyRing
from evaluator.commands.program import main
from evaluator.original.logs import as_logged, find_logs
from evaluator.records.episode import Episode, Outcome
from evaluator.scores.failures.findings import FailureMode
from evaluator.scores.grounding import grounding_of
from evaluator.scores.scoring import grade_record, score_episode
from evaluator.store.run_folder import RunFolder
from scenes import default_folder, find_pack, read_pack
from tests.builders.records import VERSIONS, episode_key

LOOK = '```json\n[{"tool": "get_velocity", "parameters": {"object_id": "object_1"}}]\n```'
STEP_AND_LOOK = (
    '```json\n[{"tool": "step", "parameters": {"duration": 0.5}}, {"tool": "apply_force", "parameters": {}},'
    ' {"tool": "get_velocity", "parameters": {"object_id": "object_1"}}]\n```'
)
READ = """Previous Results:
step(duration=0.5) -> ok
apply_force() -> ERROR: missing 2 required positional arguments
get_velocity(object_id="object_1") -> {"velocity": [0.0, 0.0, -4.9]}
[sim_time=0.5]
IMPORTANT: You have 1 iterations remaining to use the 'answer' tool."""
ANSWER = 'It falls with -4.9 m/s after 0.5 s.\n\n[{"tool": "answer", "parameters": {"answer": "-4.9"}}]'


def write(folder: Path, turns: list[tuple[str, str]], budget: int = 5) -> Path:
    """Write a log of prompts and replies into folders named after budget, model and scene."""
    title = read_pack(find_pack(7, default_folder())).metadata.scene_name
    text = "=== Experiment Log for 7 ===\n\n"
    for number, (prompt, reply) in enumerate(turns, start=1):
        shown = f"Scene Description: {title}.\n{prompt}" if number == 1 else prompt
        text += f"\n--- Iteration {number} ---\nLLM Input Prompt Below:\n{shown}\n\nLLM Response Below:\n{reply}\n"
    path = folder / f"iterations_{budget:02}" / "some_model" / "scene_007"
    path.mkdir(parents=True)
    (path / "summary_20260101T000000.txt").write_text(text, encoding="utf-8")
    return folder


def episode(folder: Path) -> Episode:
    (log,) = find_logs(folder)
    key = episode_key(agent=log.model, budget=log.budget, protocol="text")
    return as_logged(log, key, VERSIONS)


def test_calls_have_the_results_that_the_model_read(tmp_path: Path) -> None:
    played = episode(write(tmp_path, [("Find out.", STEP_AND_LOOK), (READ, ANSWER)]))
    step, force, look = played.turns[0].exchanges
    assert (step.returned, step.is_error, step.content) == (True, False, {"result": "ok"})
    assert (force.returned, force.is_error, force.text) == (True, True, "missing 2 required positional arguments")
    assert look.content == {"velocity": [0.0, 0.0, -4.9], "sim_time": 0.5}
    assert (played.outcome, played.answer, played.error) == (Outcome.ANSWERED, "-4.9", None)
    assert grounding_of(played).share == 1


def test_a_call_without_a_result_was_not_run(tmp_path: Path) -> None:
    other = 'Previous Results:\nget_position(object_id="object_1") -> {"position": [1.0, 0.0, 0.0]}\n[sim_time=0]'
    unread = "Previous results: Error: Invalid JSON syntax for tool(s)."
    played = episode(write(tmp_path, [("Find out.", LOOK), (other, LOOK), (unread, LOOK)]))
    assert [exchange.returned for turn in played.turns for exchange in turn.exchanges] == [False, False, False]
    assert (played.outcome, played.error) == (Outcome.AGENT_ERROR, "the log ends here")


def test_an_answer_after_which_the_program_continued_was_not_accepted(tmp_path: Path) -> None:
    played = episode(write(tmp_path, [("Find out.", ANSWER), ("Previous Results:\n[sim_time=0]", LOOK)], budget=2))
    assert played.turns[0].exchanges[0].returned is False
    assert (played.outcome, played.answer) == (Outcome.BUDGET_EXHAUSTED, None)


def test_logged_episodes_can_be_kept_as_a_run_folder(tmp_path: Path) -> None:
    logs = write(tmp_path / "logs", [("Find out.", STEP_AND_LOOK), (READ, ANSWER)])
    words = ["replay-original", str(logs), "--scenes-dir", str(default_folder()), "--jobs", "1"]
    assert main([*words, "--keep", str(tmp_path / "kept"), "--as-logged"]) == 0
    (kept,) = RunFolder(tmp_path / "kept").episodes().values()
    assert kept.turns[0].exchanges[2].content == {"velocity": [0.0, 0.0, -4.9], "sim_time": 0.5}
    assert kept.prompt.endswith("Find out.\n\n")
    assert kept.versions.pack


def test_the_form_of_an_answer_to_an_older_question_is_not_judged(tmp_path: Path) -> None:
    """After the log was written, the pack may have been changed to ask for a number instead of words."""
    task = read_pack(find_pack(7, default_folder())).metadata.task
    in_words = 'It gets faster.\n\n[{"tool": "answer", "parameters": {"answer": "faster"}}]'
    keys = KeyRing()
    for asked, judged in ((task, True), ("Does the ball get faster or slower?", False)):
        folder = write(tmp_path / str(judged), [(f"Task: {asked}.", STEP_AND_LOOK), (READ, in_words)])
        played = episode(folder)
        shown = score_episode(played, grade_record(played, keys), keys).failures
        assert (FailureMode.ANSWER_FORMAT in {failure.mode for failure in shown}) is judged


def test_of_several_lists_in_a_logged_reply_none_is_taken(tmp_path: Path) -> None:
    played = episode(write(tmp_path, [("Find out.", f"{LOOK}\n\nThen:\n\n{ANSWER}"), (READ, ANSWER)]))
    assert (played.turns[0].exchanges, played.turns[0].is_unread) == ((), True)
    assert [turn.is_unread for turn in played.turns] == [True, False]


def test_as_logged_requires_keep(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay-original", str(tmp_path), "--scenes-dir", str(default_folder()), "--as-logged"]) == 2
    assert "--keep DIR" in capsys.readouterr().err
