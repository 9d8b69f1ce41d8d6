"""Tests of records: each released form of `run.json` is read and written unchanged; accepted calls of an episode."""

import json
from typing import Any

import pytest

from evaluator.records.run import Plan, RunRecord, ServerRecord
from tests.builders.records import episode, refused, rejected, returned, skipped, turn

START: dict[str, Any] = {
    "created_at": "2026-11-21T18:27:41+00:00",
    "server": {"option": "host", "name": "physment-mcp", "version": "0.1.0", "protocol": "2026-07-28", "tools": 26}
    | {"tool_schema_hash": "38c9504bf7af42d6"},
    "versions": {"python": "3.11.7", "physment-mcp": "0.1.0", "mujoco": None},
    "git_revision": None,
}
PLAYED: dict[str, Any] = START | {
    "format": 1,
    "plan": {"scenes": [7, 21], "agents": ["model:x"], "budgets": [5, 20], "seeds": [0], "epochs": 1}
    | {"promptings": ["zero-shot"], "protocols": ["native"]},
    "agents": {"model:x": {"provider": "openai", "temperature": 0.5, "sent": {"stop": ["a", None]}}},
    "packs": {"7": "125dc8c43267", "21": "ae6134d1790e"},
}
RECORD = RunRecord(
    created_at="2026-01-01T00:00:00+00:00",
    plan=Plan(scenes=(7,), agents=("x",)),
    agents={"x": {"temperature": 1}},
    server=ServerRecord(option="host"),
    packs={"7": "a"},
)


@pytest.mark.parametrize(
    "stored",
    [
        PLAYED,
        PLAYED | {"shard": "1/2"},
        PLAYED | {"resumed": [START, START]},
        PLAYED | {"merged": [START | {"folder": "a", "shard": "1/2", "resumed": [START]}, START | {"folder": "b"}]},
        PLAYED | {"a field of another version": {"kept": [1, None]}, "server": START["server"] | {"load": 0.5}},
    ],
    ids=["plain", "shard", "resumed", "merged", "extended"],
)
def test_a_stored_run_is_written_again_unchanged(stored: dict[str, Any]) -> None:
    record = RunRecord.model_validate_json(json.dumps(stored))
    assert json.loads(record.model_dump_json()) == stored


def test_a_run_of_a_later_format_is_refused() -> None:
    with pytest.raises(ValueError, match="Input should be 1"):
        RunRecord.model_validate(PLAYED | {"format": 2})


@pytest.mark.parametrize(
    ("changed", "named"),
    [
        ({"created_at": "later", "git_revision": "another", "server": ServerRecord(option="stdio")}, ""),
        ({"shard": "1/2"}, ""),
        ({"plan": Plan(scenes=(7,), agents=("x",), budgets=(5,))}, "plan"),
        ({"packs": {"7": "b"}}, "packs"),
        ({"agents": {"x": {"temperature": 0}}}, "agents"),
    ],
)
def test_runs_belong_together_if_plan_packs_and_agents_are_the_same(changed: dict[str, Any], named: str) -> None:
    assert RECORD.difference(RECORD.model_copy(update=changed)) == named


def test_accepted_calls_are_those_that_the_laboratory_ran_without_error_before_the_answer() -> None:
    first = turn("", returned("step"), refused("step"), rejected("fly"))
    second = turn("", returned("get_mass"), returned("answer"), skipped("step"))
    accepted = [(number, exchange.call.tool) for number, exchange in episode(first, second).accepted_calls()]
    assert accepted == [(1, "step"), (2, "get_mass")]
