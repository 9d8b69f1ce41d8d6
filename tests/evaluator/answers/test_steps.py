"""Tests of intermediate quantities that an agent states with its answer."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from evaluator.answers.grading import grade_episode
from evaluator.answers.keys import KeyRing
from evaluator.answers.strict import AnswerKey
from evaluator.errors import UsageError
from evaluator.records.episode import Episode, Exchange, Outcome, ToolCall, Turn, Verdict
from scenes import AnswerKind, AnswerSpec, find_pack
from tests.builders.records import VERSIONS, episode_key

KEY = AnswerKey(8.0, AnswerSpec(kind=AnswerKind.NUMBER, unit="N"), steps={"acceleration": 4.0, "offset": 0.0})


def answered(answer: Any, steps: Any = None, outcome: Outcome = Outcome.ANSWERED) -> Episode:
    arguments = {"answer": answer} if steps is None else {"answer": answer, "steps": steps}
    refused = Exchange(call=ToolCall(tool="answer", arguments={"answer": {}}), returned=True, is_error=True)
    accepted = Exchange(call=ToolCall(tool="answer", arguments=arguments), returned=True)
    return Episode(
        key=episode_key(),
        outcome=outcome,
        answer=answer if outcome is Outcome.ANSWERED else None,
        prompt="",
        turns=(Turn(reasoning="", exchanges=(refused, accepted)),),
        started_at="2026-01-01T00:00:00+00:00",
        duration_s=1.0,
        versions=VERSIONS,
    )


@pytest.mark.parametrize(
    ("steps", "right"),
    [
        ({"acceleration": 4.1, "offset": 0.005}, [True, True]),
        ({"acceleration": "4.1", "offset": "0"}, [True, True]),
        ({"acceleration": 4.3}, [False, False]),
        ({"acceleration": "4.1 m/s²", "other": 1}, [False, False]),
        ({"acceleration": True, "offset": None}, [False, False]),
        (None, [False, False]),
    ],
)
def test_steps_are_graded_apart(steps: Any, right: list[bool]) -> None:
    for answer, verdict in ((8.0, Verdict.CORRECT), (5.0, Verdict.INCORRECT)):
        found = grade_episode(answered(answer, steps), KEY)
        assert found.steps == dict(zip(KEY.steps, right, strict=True))
        assert found.strict is verdict


def test_without_an_answer_no_step_is_stated() -> None:
    found = grade_episode(answered(8.0, {"acceleration": 4.0}, Outcome.BUDGET_EXHAUSTED), KEY)
    assert found.steps == {"acceleration": False, "offset": False}
    assert grade_episode(answered(8.0, None, Outcome.INFRASTRUCTURE_ERROR), KEY).steps is None


def test_a_scene_that_names_no_steps_grades_none() -> None:
    found = grade_episode(answered(8.0, {"acceleration": 4.0}), AnswerKey(8.0, KEY.spec))
    assert found.steps is None
    assert "steps" not in found.model_dump()


@pytest.mark.parametrize("seed", [0, 3])
def test_the_values_of_the_suite_follow_the_draw(seed: int) -> None:
    ring = KeyRing()
    steps = ring.key(59, seed).steps
    force = ring.key(59, seed).value
    assert isinstance(force, float)
    assert steps["acceleration"] == pytest.approx((24 - force) / 2)


def test_a_step_that_is_no_number_is_a_fault_of_the_pack(tmp_path: Path) -> None:
    folder = shutil.copytree(find_pack(59).folder, tmp_path / "packs" / "Scene59")
    pack = json.loads((folder / "scene59.json").read_text(encoding="utf-8"))
    pack["steps"]["acceleration"]["value"] = "'fast'"
    (folder / "scene59.json").write_text(json.dumps(pack), encoding="utf-8")
    with pytest.raises(UsageError, match=r"field steps\.acceleration: 'fast' is no number"):
        KeyRing(folder.parent).key(59, 0)
