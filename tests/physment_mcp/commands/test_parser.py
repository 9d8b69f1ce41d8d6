"""Tests of misspelled words on the laboratory's command line."""

import os
import pty
import subprocess
import sys

import pytest

from physment_mcp.commands.program import main


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["sevre"], "there is no command sevre; did you mean serve? (see physment-mcp --help)"),
        (["--scne", "7"], "there is no option --scne; did you mean --scene? (see physment-mcp --help)"),
        (["serve", "--prt", "8"], "there is no option --prt; did you mean --port? (see physment-mcp serve --help)"),
        (
            ["config", "--clent", "cursor"],
            "there is no option --clent; client is written without dashes: physment-mcp config claude-desktop"
            " (see physment-mcp config --help)",
        ),
        (["--scene", "seven"], "argument --scene: seven is not a whole number (see physment-mcp --help)"),
        (["--timestep", "x"], "argument --timestep: x is not a number above 0 (see physment-mcp --help)"),
    ],
)
def test_a_mistyped_word_is_answered_with_the_nearest_in_one_sentence(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    assert capsys.readouterr() == ("", f"physment-mcp: {said}\n")


@pytest.mark.parametrize(("words", "tried"), [(["--scene", "9"], "play 9"), ([], "play 7")])
def test_a_server_that_is_started_in_a_terminal_says_what_it_waits_for(words: list[str], tried: str) -> None:
    ours, terminal = pty.openpty()
    try:
        command = [sys.executable, "-m", "physment_mcp", *words]
        with subprocess.Popen(command, stdin=terminal, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            assert process.stderr is not None
            said = process.stderr.readline().decode()
            os.write(ours, b"\x04")  # Ctrl-D: the end of the input
            output, errors = process.communicate(timeout=60)
    finally:
        os.close(ours)
        os.close(terminal)
    assert said.startswith("physment-mcp: waits for messages of an MCP client")
    assert f"`physment-eval {tried}`" in said
    assert (output, errors) == (b"", b"")


def test_the_help_waits_neither_for_the_engine_nor_for_a_server_library() -> None:
    code = """
import sys
import physment_mcp.commands.program
sys.exit(" ".join({"mcp", "mujoco", "starlette", "uvicorn"} & set(sys.modules)) or 0)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")
