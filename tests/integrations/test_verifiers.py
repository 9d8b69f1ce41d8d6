"""Tests with the real verifiers: the same calls, results, outcome and grade as with `physment-eval`."""

import json
from collections.abc import Generator
from typing import Any

import httpx
import pytest
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from evaluator.records.episode import Verdict
from tests.harness.clients.scripted_model import completed, serving
from tests.integrations.playing import Stand, check_same, grade_of, json_lines, place_of, rehearsed, standing


@pytest.fixture(scope="module")
def stand(tmp_path_factory: pytest.TempPathFactory) -> Generator[Stand]:
    with standing("verifiers", tmp_path_factory.mktemp("verifiers")) as opened:
        yield opened


def evaluated(stand: Stand, name: str, *options: object, model: str | None = None) -> list[dict[str, Any]]:
    """The traces of a run of `vf-eval`."""
    words = ["--no-push", "--no-rich", "-m", "scripted", "--client.base-url", f"{model or stand.model}/v1"]
    done = stand.run("vf-eval", "physment", *words, "--run.name", name, "-o", stand.scratch / "out", *options)
    file = stand.scratch / "out" / name / "traces.jsonl"
    assert file.exists(), done.stdout[-2000:] + done.stderr[-2000:]
    traces = [trace for episode in json_lines(file) for trace in episode["traces"]]
    assert [trace["errors"] for trace in traces] == [[]] * len(traces)
    return traces


def test_an_episode_in_verifiers_has_the_same_calls_returns_outcome_and_grade_as_here(stand: Stand) -> None:
    pairs = stand.scratch / "pairs.jsonl"
    place = place_of(23, 10_004)
    pairs.write_text(f'{{"scene": 20, "seed": 3}}\n{{"split": "train", "index": {place}}}\n', encoding="utf-8")
    traces = evaluated(stand, "solved", "--env.taskset.pairs", pairs)
    keys = {trace["task"]["key"]: trace for trace in traces}
    assert set(keys) == {"scene20-seed3", f"train-index{place}"}
    assert keys[f"train-index{place}"]["info"]["physment"]["split"] == "train@1"
    for trace in traces:
        scene = trace["info"]["physment"]["scene"]
        seed = {20: 3, 23: 10_004}[scene]
        ours = rehearsed(scene, seed)
        check_same(stand.episodes()[scene, seed, 20], ours)
        assert trace["stop_condition"] == "answered"
        assert trace["rewards"]["laboratory"]["score"] == float(grade_of(ours).strict is Verdict.CORRECT) == 1.0
        assert trace["metrics"]["graded"] == grade_of(ours).graded
        said = [node["message"]["content"] for node in trace["nodes"] if node["message"]["role"] == "tool"]
        texts = [exchange.text for turn in ours.turns for exchange in turn.exchanges]
        # The rollout ends with the answer, so its return is never sent to the model.
        assert said == texts[:-1]
        names = {tool["name"] for tool in trace["tools"]}
        assert {"step", "answer"} <= names
        assert len(names) == 26


def test_iterations_are_turns_and_end_the_episode(stand: Stand) -> None:
    (trace,) = evaluated(
        stand, "short", "--env.taskset.scenes", "23", "--env.taskset.seeds", "5", "--env.taskset.task.budget", "4"
    )
    ours = rehearsed(23, 5, budget=4)
    check_same(stand.episodes()[23, 5, 4], ours)
    assert trace["stop_condition"] == "budget_exhausted"
    assert trace["rewards"]["laboratory"]["score"] == 0.0


def test_worlds_and_draws_from_a_curriculum_are_opened(stand: Stand) -> None:
    once, draws = ("--env.taskset.task.budget", "1"), ("--env.taskset.random_seeds", "1")
    (trace,) = evaluated(stand, "world", *once, "--env.taskset.levels", "1", "--env.taskset.indices", "0")
    assert (trace["task"]["key"], trace["info"]["physment"]["world"]) == ("level1-index0", "world:1:0")
    (trace,) = evaluated(stand, "drawn", *once, *draws, "--env.taskset.split", "train", "--env.taskset.curriculum", "c")
    assert trace["task"]["key"] == "c-train-random_seed1"
    window = httpx.get(f"{stand.referee}/curricula/c").json()
    assert trace["info"]["physment"]["scene"] in window["steps"][0]


async def talk_then_answer(request: Request) -> Response:
    """A model that first writes only prose, then makes two calls without usable arguments, and then answers wrongly."""
    body = await request.json()
    said = [message["role"] for message in body["messages"]].count("assistant")
    if said == 0:
        return completed(body, {"role": "assistant", "content": "I think it falls."})
    arguments = ["{", "[1]"] if said == 1 else [json.dumps({"answer": -1.0})]
    calls = [
        {"id": f"call_{number}", "type": "function", "function": {"name": "answer", "arguments": text}}
        for number, text in enumerate(arguments)
    ]
    return completed(body, {"role": "assistant", "content": None, "tool_calls": calls})


def test_a_reply_without_a_call_costs_its_iteration_and_does_not_end_the_episode(stand: Stand) -> None:
    with serving(Starlette(routes=[Route("/v1/chat/completions", talk_then_answer, methods=["POST"])])) as model:
        (trace,) = evaluated(stand, "talk", "--env.taskset.scenes", "7", "--env.taskset.seeds", "6", model=model)
    said = [node["message"] for node in trace["nodes"]]
    roles = ["user", "assistant", "user", "assistant", "tool", "tool", "assistant"]
    assert [message["role"] for message in said] == roles
    assert said[2]["content"] == "Your reply held no tool call.\n\nIterations left: 19."
    assert ["JSON object" in message["content"] for message in said[4:6]] == [True, True]
    assert (trace["stop_condition"], trace["rewards"]["laboratory"]["score"]) == ("answered", 0.0)


def test_the_validation_of_verifiers_finds_the_tasks_sound(stand: Stand) -> None:
    words = ["--taskset.scenes", "7,21", "--taskset.seeds", "1-2", "--runtime.type", "subprocess", "--no-rich"]
    done = stand.run("vf-validate", "physment", *words, "--run.name", "check", "-o", stand.scratch / "out")
    summary = json.loads((stand.scratch / "out" / "check" / "summary.json").read_text(encoding="utf-8"))
    assert summary["checks"]["gold"]["valid"] == summary["checks"]["noop"]["valid"] == 4, done.stdout[-2000:]


def test_without_a_referee_it_says_what_to_start(stand: Stand) -> None:
    words = ["--runtime.type", "subprocess", "--no-rich", "--run.name", "alone", "-o", stand.scratch / "out"]
    stand.run("vf-validate", "physment", *words, PHYSMENT_REFEREE_URL="http://127.0.0.1:9")
    (row,) = json_lines(stand.scratch / "out" / "alone" / "results.jsonl")
    assert "start `physment-eval referee`" in row["gold"]["error"]


def test_another_version_of_verifiers_is_refused_in_one_sentence(stand: Stand) -> None:
    code = "import importlib.metadata as m; m.version = lambda name: '0.5.0'; import physment"
    done = stand.run("python", "-c", code)
    assert done.stderr.splitlines()[-1] == (
        "ImportError: physment-verifiers is tested with verifiers 0.4 and not with 0.5.0:"
        " pip install 'verifiers==0.4.*'"
    )
