"""Tests that an unread standard error blocks neither the program nor its exit."""

import subprocess
import sys

import pytest

LINES = 5000


@pytest.mark.parametrize("read", [True, False])
def test_lines_are_written_or_lost_and_never_waited_for(read: bool) -> None:
    """Writes 5000 lines of 200 characters, far more than a pipe can buffer."""
    source = f"""
import logging
from physment_mcp.commands.program import NonBlockingLog
logging.basicConfig(handlers=[NonBlockingLog()], format="%(message)s")
for number in range({LINES}):
    logging.warning("%d %s", number, "x" * 200)
print("done", flush=True)
"""
    process = subprocess.Popen(
        [sys.executable, "-c", source], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        if read:
            out, err = process.communicate(timeout=60)
            assert out == "done\n"
            assert err.startswith("0 x")
        else:
            assert process.stdout is not None
            assert process.stdout.readline() == "done\n"
            assert process.wait(60) == 0
    finally:
        process.kill()
        process.communicate()
