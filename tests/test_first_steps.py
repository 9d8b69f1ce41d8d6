"""Tests of the tutorials: their commands and calls are run, and must print what the page shows."""

import contextlib
import io
import re
import shlex
from pathlib import Path

from tests.builders.commands import physment_eval
from tests.builders.paths import DOCS

QUOTED = re.compile(r"(?:^> .*\n)+", re.MULTILINE)
TYPED = re.compile(r"^(\d+ iterations? left > )(.+)\n", re.MULTILINE)


def parts(name: str) -> list[tuple[str, str]]:
    """Return the blocks of a tutorial in order, each with its language; a quote becomes one line of text."""
    text = (DOCS / "tutorials" / f"{name}.md").read_text(encoding="utf-8")
    quoted = QUOTED.sub(lambda lines: "```text\n" + lines[0][2:].replace("\n> ", " ") + "```\n", text)
    return re.findall(r"^```(\w+)\n(.*?)^```$", quoted, re.DOTALL | re.MULTILINE)


def test_the_first_experiment_goes_as_the_page_says(tmp_path: Path, host_url: str) -> None:
    """Typed text is not echoed, because standard input is not a terminal here."""
    episodes: list[tuple[str, list[str]]] = []
    for language, block in parts("your-first-experiment"):
        if language == "sh":
            episodes.append((block, []))
        elif language == "text":
            episodes[-1][1].append(block)
    assert len(episodes) == 2
    for command, blocks in episodes:
        typed = "\n".join(line for block in blocks for _, line in TYPED.findall(block))
        done = physment_eval(*shlex.split(command)[1:], "--server", host_url, typed=typed, cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        for block in blocks:
            assert TYPED.sub(r"\1", block).strip() in done.stdout


def test_the_arithmetic_of_the_first_experiment_is_right() -> None:
    (program,) = (block for language, block in parts("your-first-experiment") if language == "python")
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(compile(program, "page", "exec"), {})
    assert printed.getvalue().split() == re.findall(r"# → (.+)$", program, re.MULTILINE)


def test_the_commands_of_the_first_evaluation_print_what_the_page_says(tmp_path: Path, host_url: str) -> None:
    """The commands run with a host that is already running and without workers, to save time."""
    printed = ""
    for language, block in parts("your-first-evaluation"):
        if language == "text":
            assert [line for line in block.splitlines() if line not in printed] == []
            continue
        for line in block.splitlines():
            done = physment_eval(
                *shlex.split(line.replace("--server host", f"--server {host_url} --workers 1"))[1:], cwd=tmp_path
            )
            assert done.returncode == 0, done.stderr
            printed = done.stdout
    assert (tmp_path / "runs" / "first" / "report.html").is_file()
