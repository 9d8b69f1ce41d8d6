"""Tests that external programs, their children, the host and the folders do not outlive the evaluator."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from tests.builders.commands import heed_signals
from tests.evaluator.agents.external.test_external import gone, until

STUBBORN = """
import json, os, pathlib, signal, subprocess, sys, time
for sign in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
    signal.signal(sign, signal.SIG_IGN)
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
base = str(pathlib.Path.cwd().parent)
said = json.dumps({"program": os.getpid(), "child": child.pid, "evaluator": os.getppid(), "base": base})
pathlib.Path(NOTE).with_suffix(".new").write_text(said)
pathlib.Path(NOTE).with_suffix(".new").rename(NOTE)
time.sleep(600)
"""


def children_of(parent: int) -> list[int]:
    found = subprocess.run(["ps", "-o", "pid=", "--ppid", str(parent)], capture_output=True, text=True, check=False)
    return [int(line) for line in found.stdout.split()]


@pytest.mark.parametrize(
    "how",
    [
        signal.SIGINT,
        signal.SIGKILL,
        pytest.param(signal.SIGTERM, marks=pytest.mark.extended),
        pytest.param(signal.SIGHUP, marks=pytest.mark.extended),
    ],
    ids=lambda how: how.name,
)
async def test_nothing_is_left_behind(tmp_path: Path, how: signal.Signals) -> None:
    note = tmp_path / "note"
    program = tmp_path / "stubborn.py"
    program.write_text(STUBBORN.replace("NOTE", repr(str(note))), encoding="utf-8")
    words = ["--agent", "external", "--server", "host", "--scenes", "7", "--out", str(tmp_path / "run")]
    command = [sys.executable, "-m", "evaluator", "run", *words, "--", sys.executable, str(program), "{mcp_config}"]
    evaluator = subprocess.Popen(  # noqa: ASYNC220
        command,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        preexec_fn=heed_signals,  # noqa: PLW1509 - two system calls
    )
    try:
        await until(note.exists)
        said = json.loads(note.read_text(encoding="utf-8"))
        assert said["evaluator"] == evaluator.pid
        assert os.path.isdir(said["base"])  # noqa: ASYNC240, PTH112
        started = children_of(evaluator.pid)
        assert len(started) == 3, "the host, the program and its watchdog"
        os.kill(evaluator.pid, how)
        evaluator.wait()
        await gone(said["program"], said["child"], *started)
        await until(lambda: not os.path.isdir(said["base"]))  # noqa: PTH112
    finally:
        evaluator.kill()
        evaluator.wait()
