"""Tests of packs in the published format, written for these tests: no answer form, no knobs, no category.

A key is a number, the number of a case, or a list. The form of the answer follows from key and problem type.
"""

import json
from pathlib import Path
from typing import Any

import pytest
from pydantic import JsonValue

from evaluator.answers.grading import grade, grade_episode
from evaluator.answers.keys import KeyRing
from evaluator.original.logs import as_logged, find_logs
from evaluator.original.play import scene_of
from evaluator.records.episode import Verdict
from evaluator.scores.failures.detect import failures_of
from evaluator.scores.failures.findings import expected_form
from physment_mcp.scene import load_scene
from physment_mcp.session import Session
from physment_mcp.tools.calls import call
from scenes import PackFiles, list_packs, read_pack
from scenes.answer_spec import AnswerKind
from tests.builders.records import VERSIONS, episode_key

FOLDER = Path(__file__).parent / "published_format"
SPRING, BALLS, PUCK = 1, 2, 3


def read(session: Session, tool: str, **arguments: JsonValue) -> dict[str, Any]:
    return call(session, tool, {"object_id": "object_1", **arguments}).model_dump()


@pytest.mark.parametrize("files", list_packs(FOLDER), ids=lambda files: str(files.scene_id))
def test_a_pack_in_the_published_format_loads_and_runs_for_a_second(files: PackFiles) -> None:
    session = Session(load_scene(files.scene_id, 0, FOLDER))
    session.world.step(session.world.whole_steps(1.0))
    assert session.world.time == pytest.approx(1, abs=session.world.timestep)
    assert session.known()


@pytest.mark.parametrize(
    ("scene", "kind", "value"),
    [
        (SPRING, AnswerKind.NUMBER, 40.0),
        (BALLS, AnswerKind.CHOICE, 2),
        (PUCK, AnswerKind.NUMBERS, (1.5, 2.25)),
    ],
)
def test_the_form_of_the_answer_follows_from_the_key_and_the_problem_type(
    scene: int, kind: AnswerKind, value: object
) -> None:
    key = KeyRing(FOLDER).key(scene, 0)
    assert (key.spec.kind, key.value) == (kind, value)
    assert KeyRing(FOLDER).key(scene, 5) == key, "without a draw every seed is the same scene"


@pytest.mark.parametrize(
    ("scene", "answer", "right"),
    [
        (SPRING, 41.9, True),
        (SPRING, "38.1", True),
        (SPRING, 42.1, False),
        (SPRING, "40, 40", False),
        (BALLS, "2", True),
        (BALLS, 1.95, False),
        (PUCK, [1.45, 2.3], True),
        (PUCK, "1.5, 2.25", True),
        (PUCK, [2.25, 1.5], False),
    ],
)
def test_answers_are_graded_by_that_form(scene: int, answer: JsonValue, *, right: bool) -> None:
    assert (grade(answer, KeyRing(FOLDER).key(scene, 0)).strict is Verdict.CORRECT) is right


def test_the_experiments_give_the_keys() -> None:
    spring, balls, puck = (Session(load_scene(scene, 0, FOLDER)) for scene in (SPRING, BALLS, PUCK))
    start = read(spring, "get_position")["position"]
    read(spring, "apply_force", force_vector=[4, 0, 0])
    call(spring, "step", {"duration": 10})
    end = read(spring, "get_position")["position"]
    for name in ("object_1", "object_2"):
        call(balls, "apply_force", {"object_id": name, "force_vector": [0, 0, 60]})
    call(balls, "step", {"duration": 0.2})
    heights = [
        call(balls, "get_position", {"object_id": name}).model_dump()["position"][2]
        for name in ("object_1", "object_2")
    ]
    read(puck, "apply_force", force_vector=[6, 0, 0])
    call(puck, "step", {"duration": 0.5})
    speed = read(puck, "get_velocity")["velocity"][0]
    energy = read(puck, "get_kinetic_energy", mass=2)["kinetic_energy"]
    stiffness, higher = 4 / (end[0] - start[0]), 1 + heights.index(max(heights))
    for scene, answer in ((SPRING, stiffness), (BALLS, higher), (PUCK, [speed, energy])):
        assert grade(answer, KeyRing(FOLDER).key(scene, 0)).strict is Verdict.CORRECT, (scene, answer)


@pytest.mark.parametrize(
    ("answer", "right", "modes"),
    [
        ("40", True, ["premature_answer"]),
        ("about forty", False, ["premature_answer", "answer_format_mismatch"]),
    ],
)
def test_a_log_of_such_a_scene_is_graded_and_its_failures_are_found(
    tmp_path: Path, answer: str, modes: list[str], *, right: bool
) -> None:
    names = {files.scene_id: read_pack(files).metadata.scene_name for files in list_packs(FOLDER)}
    called = [{"tool": "answer", "parameters": {"answer": answer}}]
    folder = tmp_path / "iterations_05" / "some_model" / "scene_001"
    folder.mkdir(parents=True)
    (folder / "summary_20260101T000000.txt").write_text(
        "=== Experiment Log for 1 ===\n\n\n--- Iteration 1 ---\nLLM Input Prompt Below:\n"
        f"Scene Description: {names[SPRING]}.\nTask.\n\nLLM Response Below:\nI am sure.\n{json.dumps(called)}\n",
        encoding="utf-8",
    )
    (log,) = find_logs(tmp_path)
    assert scene_of(log, names) == SPRING
    key = KeyRing(FOLDER).key(SPRING, 0)
    played = as_logged(log, episode_key(SPRING, agent=log.model, budget=5), VERSIONS)
    found = grade_episode(played, key)
    assert (found.strict is Verdict.CORRECT) is right
    assert [failure.mode.value for failure in failures_of(played, found, expected_form(key))] == modes
