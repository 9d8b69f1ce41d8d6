"""Tests that a jump of the wall clock changes only timestamps: durations follow the monotonic clock."""

import ast
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from pydantic_ai import exceptions as ai

from evaluator.agents.models.requests import AskAgain, judge
from evaluator.store.run_folder import RunFolder
from tests.builders.paths import ROOT

STAMPS = {
    "physment_mcp/serving/episode_server.py": {"_create"},
    "evaluator/records/episode.py": {"timestamp"},
    "evaluator/study/runner.py": {"write"},
    "evaluator/watch/app.py": {"_look"},
    "evaluator/commands/base.py": {"usual_folder"},
    "evaluator/commands/challenge_session.py": {"_start_clock"},
}
"""Module → functions that may read the wall clock.

Each needs it for a timestamp: a start time, an expiry time, the name of a folder, or the age of a timestamp.
"""
WALL = {"time.time", "time.time_ns", "time.localtime", "time.gmtime", "time.ctime", "time.strftime", "datetime.now",
        "datetime.utcnow", "datetime.today", "date.today"}  # fmt: skip

JUMPING = """
import datetime, itertools, time

usual, present = time.time, datetime.datetime
jumps = itertools.cycle((3600, 0, -3600, 86400))
time.time = lambda: usual() + next(jumps)
time.time_ns = lambda: int(1e9 * time.time())

class Jumping(present):
    @classmethod
    def now(cls, tz=None):
        return present.now(tz) + datetime.timedelta(seconds=next(jumps))

datetime.datetime = Jumping
"""
"""Code that every Python process of a run executes at its start.

It makes each reading of the wall clock an hour wrong, alternately forward and back.
"""


def readings(tree: ast.AST, function: str = "") -> Iterator[tuple[str, str]]:
    """Return the function and the name of each use of a wall clock."""
    for node in ast.iter_child_nodes(tree):
        inside = node.name if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) else function
        if isinstance(node, ast.Attribute) and ast.unparse(node) in WALL:
            yield inside, ast.unparse(node)
        if isinstance(node, ast.ImportFrom) and node.module == "time":
            yield inside, f"from time import {', '.join(name.name for name in node.names)}"
        yield from readings(node, inside)


def test_the_wall_clock_is_read_for_stamps_alone() -> None:
    read: dict[str, set[str]] = {}
    for package in ("physment_mcp", "evaluator", "scenes"):
        for file in sorted((ROOT / package).rglob("*.py")):
            found = {function for function, _ in readings(ast.parse(file.read_text(encoding="utf-8")))}
            if found:
                read[str(file.relative_to(ROOT))] = found
    assert read == STAMPS


def run(folder: Path, *options: str, jumping: bool) -> RunFolder:
    folder.mkdir()
    (folder / "sitecustomize.py").write_text(JUMPING if jumping else "", encoding="utf-8")
    path = os.pathsep.join([str(folder), str(ROOT)])
    done = subprocess.run(
        [sys.executable, "-m", "evaluator", "--out", "run", *options],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return RunFolder(folder / "run")


def durations(value: Any) -> Iterator[float]:
    """Every wall time in a record [s]."""
    if isinstance(value, dict):
        for name, part in value.items():
            if name in {"duration_s", "agent_s", "server_s"} and part is not None:
                yield float(part)
            else:
                yield from durations(part)
    elif isinstance(value, list):
        for part in value:
            yield from durations(part)


PROGRAM = ("--max-wall-time", "500", "--", sys.executable, "-c", "print('I know nothing')", "{mcp_url}")


@pytest.mark.parametrize(
    ("agent", "more"), [pytest.param("reference", (), marks=pytest.mark.extended), ("external", PROGRAM)]
)
def test_a_run_whose_wall_clock_jumps_by_an_hour_is_as_any_other(
    tmp_path: Path, agent: str, more: tuple[str, ...]
) -> None:
    options = ("--agent", agent, "--scenes", "7,8", "--seeds", "0", "--server", "host", "--max-time", "600", *more)
    usual, jumped = (run(tmp_path / name, *options, jumping=name == "jumped") for name in ("usual", "jumped"))
    records = [json.loads(line) for line in jumped.episodes_file.read_bytes().splitlines()]
    off = [abs((datetime.fromisoformat(one["started_at"]) - datetime.now(UTC)).total_seconds()) for one in records]
    assert max(off) > 3000, "the clock did not jump"
    took = list(durations(records))
    assert len(took) >= len(records)
    assert all(0 <= one < 600 for one in took)
    for first, second in zip(usual.episodes().values(), jumped.episodes().values(), strict=True):
        assert (first.answer, first.outcome, first.error) == (second.answer, second.outcome, second.error)


@pytest.mark.parametrize(
    ("headers", "wait_s"),
    [
        ({"Date": "Mon, 01 Jan 2001 10:00:00 GMT", "Retry-After": "Mon, 01 Jan 2001 10:00:30 GMT"}, 30),
        ({"Date": "Tue, 01 Jan 2092 10:00:00 GMT", "Retry-After": "Tue, 01 Jan 2092 10:00:07 GMT"}, 7),
        ({"Date": "Mon, 01 Jan 2001 10:00:00 GMT", "Retry-After": "Mon, 01 Jan 2001 09:00:00 GMT"}, 0),
        ({"Date": "Mon, 01 Jan 2001 10:00:00 GMT", "Retry-After": "12"}, 12),
        ({"Date": "yesterday", "Retry-After": "2.5"}, 2.5),
        ({"Date": "Mon, 01 Jan 2001 10:00:00 GMT"}, None),
    ],
)
def test_a_provider_that_names_a_time_is_waited_for_by_its_own_clock(
    headers: dict[str, str], wait_s: float | None
) -> None:
    failure = judge(ai.ModelHTTPError(429, "model", headers=headers), "key")
    assert isinstance(failure, AskAgain)
    assert failure.wait_s == wait_s
