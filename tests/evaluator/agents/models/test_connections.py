"""Tests that a run closes all connections to providers, even if its agents are wrapped."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.builders.providers import Service

MODEL = "model:openai-compatible:m"


@pytest.mark.parametrize("stopping", ["always", "budget-aware"])
def test_a_run_closes_the_connections_of_plain_and_wrapped_models(
    openai: Service, stopping: str, tmp_path: Path, host_url: str
) -> None:
    for _ in range(2):
        openai.say("", [("step", {"duration": 0.8})])
        openai.say("", [("answer", {"answer": 7.8})])
    # Python itself warns about a connection that is never closed.
    command = [
        sys.executable,
        "-W",
        "always::ResourceWarning",
        "-m",
        "evaluator",
        "run",
        "--server",
        host_url,
        "--scenes",
        "7",
    ]
    command += ["--agent", MODEL, "--agent", f"oracle-once:{MODEL}", "--base-url", openai.url, "--concurrency", "1"]
    done = subprocess.run(
        [*command, "--stopping", stopping, "--out", "run"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert len(openai.seen) == 4
