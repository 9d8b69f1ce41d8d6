"""Tests of the export to Every Eval Ever: accuracies per collection, whole episodes, and no answer keys."""

import hashlib
import json
from pathlib import Path, PurePosixPath
from typing import Any

import pytest

from evaluator.commands.program import main
from evaluator.errors import UsageError
from evaluator.records.episode import Episode, GradeRecord, Verdict
from evaluator.records.run import AdaptivePlan, Plan, RunRecord, ServerRecord
from evaluator.report.every_eval_ever import Source, every_eval_ever
from tests.builders.records import RIGHT, STARTED_AT, WRONG, episode, episode_key, refused, returned, skipped, turn

KEY = 3.14159
SOURCE = Source("Example University")
TURNS = (
    turn("I look.", returned("get_position", {"sim_time": 0.5, "position": [0, 0, 1]}, object_id="object_1")),
    turn("", refused("step", "too long", duration=9), skipped("step", duration=1)),
)


def graded(scene: int, verdict: Verdict = Verdict.CORRECT, agent: str = "model:a/b") -> tuple[Episode, GradeRecord]:
    grade = RIGHT if verdict is Verdict.CORRECT else WRONG.model_copy(update={"strict": verdict})
    played = episode(*TURNS, key=episode_key(scene, agent=agent), answer=[1, "m"])
    return played, GradeRecord(key=played.key, grade=grade, answer_key=KEY, grader_version="3", pack_version="0")


def run_of(*agents: str) -> RunRecord:
    return RunRecord(
        created_at=STARTED_AT,
        plan=Plan(scenes=(7, 8, 201), agents=agents),
        agents={"model:a/b": {"provider": "openai", "model": "a/b: new"}},
        server=ServerRecord(option="host"),
        versions={"physment-mcp": "0.2.0"},
    )


def written(agent: str = "model:a/b") -> tuple[dict[str, Any], list[dict[str, Any]], str]:
    pairs = [graded(7, agent=agent), graded(8, Verdict.INCORRECT, agent), graded(9, Verdict.UNSCORED, agent)]
    pairs += [graded(201, agent=agent)]
    whole, text = every_eval_ever(run_of(agent), pairs, SOURCE).values()
    return json.loads(whole), [json.loads(line) for line in text.splitlines()], text


def test_each_collection_has_its_accuracy_with_an_interval() -> None:
    record, _, _ = written()
    suite, open_worlds = record["evaluation_results"]
    assert (suite["evaluation_name"], open_worlds["evaluation_name"]) == ("physment", "physment-open-worlds")
    score = suite["score_details"]
    assert score["score"] == 0.5
    assert score["details"] == {"episodes": "3", "scored": "2", "scenes": "2"}
    interval = score["uncertainty"]["confidence_interval"]
    assert interval["lower"] < 0.5 < interval["upper"]
    assert open_worlds["score_details"]["score"] == 1.0


def test_a_result_states_how_scenes_were_presented_and_chosen() -> None:
    run = run_of("model:a/b")
    plan = run.plan.model_copy(
        update={"presentation": ("names", "units"), "adaptive": AdaptivePlan(se=0.3, difficulties_sha256="0" * 64)}
    )
    for one, expected in (
        (plan, ("names,units", "chosen adaptively, by the answers before")),
        (run.plan, ("original", "named")),
    ):
        files = every_eval_ever(run.model_copy(update={"plan": one}), [graded(7)], SOURCE)
        (result,) = json.loads(next(iter(files.values())))["evaluation_results"]
        settings = result["generation_config"]["additional_details"]
        assert (settings["presentation"], settings["scenes"]) == expected


def test_samples_are_whole_and_refer_to_their_result() -> None:
    record, samples, text = written()
    about = record["detailed_evaluation_results"]
    assert about["total_rows"] == len(samples) == 4
    assert about["checksum"] == hashlib.sha256(text.encode()).hexdigest()
    assert about["file_path"] in map(str, every_eval_ever(run_of("model:a/b"), [graded(7)], SOURCE))
    results = {result["evaluation_result_id"] for result in record["evaluation_results"]}
    assert {sample["evaluation_result_id"] for sample in samples} == results
    assert {sample["evaluation_id"] for sample in samples} == {record["evaluation_id"]}
    first = samples[0]
    assert [message["role"] for message in first["messages"]] == [
        "user",
        "assistant",
        "tool",
        "assistant",
        *["tool"] * 2,
    ]
    assert first["messages"][1]["tool_calls"][0]["arguments"] == {"object_id": "object_1"}
    assert first["messages"][-1]["content"].startswith("Not run.")
    assert first["answer_attribution"][0]["extracted_value"] == '[1, "m"]'
    assert [sample["evaluation"]["is_correct"] for sample in samples] == [True, False, False, True]


def test_no_file_holds_an_answer_key() -> None:
    record, samples, text = written()
    assert str(KEY) not in text + json.dumps(record)
    assert all(sample["input"]["reference"] == [] for sample in samples)
    assert all(sample["metadata"]["canary"].startswith("physment-canary-") for sample in samples)


@pytest.mark.parametrize(
    ("agent", "model"),
    [
        ("model:a/b", "a/b--new"),
        ("random", "physment/random"),
        ("../..", "-/-"),
        ("/", "-/-"),
    ],
)
def test_a_model_names_its_folder_and_cannot_leave_it(agent: str, model: str) -> None:
    files = every_eval_ever(run_of(agent), [graded(7, agent=agent)], SOURCE)
    assert json.loads(next(iter(files.values())))["model_info"]["id"] == model
    assert {place.parent for place in files} == {PurePosixPath("data", "physment", model)}


@pytest.mark.parametrize("created_at", ["yesterday", "9999-12-31T23:59:59-23:59"])
def test_a_damaged_time_is_refused_in_one_sentence(created_at: str) -> None:
    run = run_of("model:a/b").model_copy(update={"created_at": created_at})
    with pytest.raises(UsageError, match=r"created_at of run\.json is no time"):
        every_eval_ever(run, [graded(7)], SOURCE)


def test_a_second_export_gives_the_same_ids() -> None:
    assert written()[0] == written()[0]


def test_who_reports_must_be_stated(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(tmp_path), "--to", "every-eval-ever"]) == 2
    assert "--organization NAME" in capsys.readouterr().err


def test_the_command_writes_the_files(tmp_path: Path, host_url: str, capsys: pytest.CaptureFixture[str]) -> None:
    run = tmp_path / "run"
    assert main(["run", "--agent", "random", "--scenes", "7", "--server", host_url, "--out", str(run)]) == 0
    capsys.readouterr()
    assert main(["export", str(run), "--to", "every-eval-ever", "--organization", "Example University"]) == 0
    whole, samples = map(Path, capsys.readouterr().out.split())
    record = json.loads(whole.read_text(encoding="utf-8"))
    assert run / record["detailed_evaluation_results"]["file_path"] == samples
    assert record["source_metadata"]["source_organization_name"] == "Example University"
