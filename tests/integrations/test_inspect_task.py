# The optional library is not in the environment in which types are checked.
# pyright: reportMissingImports=false
# ruff: noqa: E402 - imports that need the library follow the check that it is installed

"""Tests that Inspect AI plays and grades as `physment-eval` does: equal turns, results, outcome, answer, verdicts."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

inspect_ai = pytest.importorskip(
    "inspect_ai", reason="inspect_ai is not installed; `python -m tests.harness.frameworks inspect` runs this"
)

from inspect_ai.model import ModelOutput, ModelUsage, get_model
from physment_inspect.task import EPISODE, physment

from evaluator.answers.grading import grade_episode
from evaluator.answers.keys import KeyRing
from evaluator.episode.connect import ProcessConnector
from evaluator.episode.loop import play_episode
from evaluator.episode.player import Agent, Briefing, Feedback, Reply
from evaluator.errors import UsageError
from evaluator.records.episode import Episode, EpisodeKey, Outcome, Verdict
from tests.builders.records import VERSIONS, call, episode_key
from tests.harness.clients.playing import Rehearsed, canonical, exchanges_of
from tests.harness.clients.scripted_model import KEY, Conversation, app, next_call, serving

USAGE = ModelUsage(input_tokens=10, output_tokens=2, total_tokens=12)
Outputs = Callable[..., ModelOutput]

pytestmark = pytest.mark.filterwarnings("default")  # warnings of a library with a hundred dependencies


def rehearsed(messages: list[Any], *_: object) -> ModelOutput:
    """The scripted model as a model of Inspect."""
    returns = tuple(message.text for message in messages if message.role == "tool")
    call = next_call(Conversation(messages[0].text, returns, frozenset()))
    assert call is not None
    output = ModelOutput.for_tool_call("mockllm", call.tool, call.arguments)
    output.usage = USAGE
    return output


def wrong(messages: list[Any], *_: object) -> ModelOutput:
    output = ModelOutput.for_tool_call("mockllm", "answer", {"answer": -1.0})
    output.usage = USAGE
    return output


def misfitting(messages: list[Any], *_: object) -> ModelOutput:
    output = ModelOutput.for_tool_call("mockllm", "step", {"duration": "long"})
    output.usage = USAGE
    return output


class Repeating:
    """An agent that makes the same call in each turn."""

    def __init__(self, tool: str, arguments: dict[str, Any]) -> None:
        self.name = "repeating"
        self._call = call(tool, **arguments)

    def player(self, key: EpisodeKey, briefing: Briefing) -> "Repeating":
        return self

    async def act(self, feedback: Feedback | None) -> Reply:
        return Reply(calls=(self._call,))


def play_in_inspect(outputs: Outputs, scene: int, budget: int, log_dir: Path) -> tuple[Episode, Any]:
    model = get_model("mockllm/model", custom_outputs=outputs)
    (log,) = inspect_ai.eval(
        physment(scenes=str(scene), budget=budget), model=model, log_dir=str(log_dir), display="none"
    )
    assert log.status == "success", log.error
    assert log.samples is not None
    (sample,) = log.samples
    assert sample.limit is None
    return Episode.model_validate(sample.store[EPISODE]), sample


async def play_here(agent: Agent, scene: int, budget: int) -> Episode:
    key = episode_key(scene, agent=agent.name, budget=budget)
    async with ProcessConnector((sys.executable, "-m", "physment_mcp")).open(scene, 0) as client:
        return await play_episode(agent, client, key, VERSIONS)


CASES = {
    "solved": (23, 20, rehearsed, Rehearsed(), Outcome.ANSWERED, 1.0),
    "wrong": (7, 20, wrong, Repeating("answer", {"answer": -1.0}), Outcome.ANSWERED, 0.0),
    "out of budget": (7, 4, misfitting, Repeating("step", {"duration": "long"}), Outcome.BUDGET_EXHAUSTED, 0.0),
    "out of budget before the answer": (23, 7, rehearsed, Rehearsed(), Outcome.BUDGET_EXHAUSTED, 0.0),
}


@pytest.mark.parametrize("case", CASES)
def test_an_episode_in_inspect_has_the_same_turns_and_grade_as_here(case: str, tmp_path: Path) -> None:
    import anyio

    scene, budget, outputs, agent, outcome, strict = CASES[case]
    theirs, sample = play_in_inspect(outputs, scene, budget, tmp_path)
    ours = anyio.run(play_here, agent, scene, budget)
    assert (theirs.outcome, theirs.answer, theirs.prompt) == (outcome, ours.answer, ours.prompt)
    assert ours.outcome is outcome
    assert list(map(canonical, exchanges_of(theirs))) == list(map(canonical, exchanges_of(ours)))
    assert [turn.note for turn in theirs.turns] == [turn.note for turn in ours.turns]
    grade = grade_episode(ours, KeyRing().key(scene, 0))
    score = sample.scores["laboratory_grade"]
    assert score.value == {
        "strict": float(grade.strict is Verdict.CORRECT),
        "normalised": float(grade.normalised is Verdict.CORRECT),
        "graded": grade.graded or 0.0,
    }
    assert (score.value["strict"], score.explanation) == (strict, grade.reason)


def test_a_model_in_inspect_gets_the_same_texts_as_here(tmp_path: Path) -> None:
    episode, sample = play_in_inspect(rehearsed, 23, 20, tmp_path)
    said = [message.text for message in sample.messages]
    assert said[0] == episode.prompt
    returns = [message.text for message in sample.messages if message.role == "tool"]
    assert returns == [exchange.text for exchange in exchanges_of(episode)][:-1]  # the result of the answer is not sent
    assert said[3] == "Iterations left: 19."


def test_a_sample_does_not_contain_the_key() -> None:
    (sample,) = physment(scenes="23").dataset
    assert not sample.target
    assert set(sample.metadata or {}) == {"key", "category", "problem_type"}


def test_a_split_gives_scenes_and_seeds_and_an_unknown_one_is_refused() -> None:
    task = physment(split="test-ideas", scenes="8,30", seeds="0-2")
    keys = [EpisodeKey.model_validate((sample.metadata or {})["key"]) for sample in task.dataset]
    assert [(key.scene, key.seed) for key in keys] == [(scene, seed) for scene in (8, 30) for seed in range(3)]
    assert (task.metadata or {})["split"] == "test-ideas@1"
    assert len(physment(split="validation", scenes=7).dataset) == 20
    with pytest.raises(UsageError, match="there is no split 'tests'; the splits are train"):
        physment(split="tests")
    with pytest.raises(UsageError, match="come from a key that its publisher keeps"):
        physment(split="held-back")


def test_inspect_eval_finds_and_plays_the_task_by_its_name(tmp_path: Path) -> None:
    with serving(app()) as provider:
        words = ["eval", "physment_inspect/physment", "--model", "openai/gpt-5.5", "-M", "responses_api=false"]
        words += ["-T", "scenes=20,23", "-T", "budget=15", "--log-dir", str(tmp_path), "--log-format", "json"]
        environment = os.environ | {"OPENAI_BASE_URL": f"{provider}/v1", "OPENAI_API_KEY": KEY}
        done = subprocess.run(
            [str(Path(sys.executable).parent / "inspect"), *words, "--display", "plain"],
            cwd=tmp_path, env=environment, capture_output=True, text=True, check=False, timeout=300,
        )  # fmt: skip
    (log,) = tmp_path.glob("*.json")
    result = json.loads(log.read_text(encoding="utf-8"))
    assert result["status"] == "success", done.stdout[-2000:]
    scores = {score["name"]: score["metrics"]["mean"]["value"] for score in result["results"]["scores"]}
    assert scores == {"strict": 1.0, "normalised": 1.0, "graded": 1.0}
