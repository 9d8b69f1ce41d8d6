"""Tests of tutorials/your-first-agent.md: its programs are saved under the given names, and its commands are run."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from evaluator import Verdict, load_run
from tests.builders.paths import DOCS

PAGE = (DOCS / "tutorials" / "your-first-agent.md").read_text(encoding="utf-8")
PROGRAMS = re.findall(r"`(\w+\.py)`[^\n`]*:\n\n```python\n(.*?)```", PAGE, flags=re.DOTALL)
COMMANDS = re.findall(r"```sh\n(physment-eval .*?)\n```", PAGE, flags=re.DOTALL)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the programs of the tutorial."""
    target = tmp_path_factory.mktemp("tutorial")
    for name, source in PROGRAMS:
        (target / name).write_text(source, encoding="utf-8")
    return target


def called(folder: Path, *words: str) -> str:
    done = subprocess.run([sys.executable, *words], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_agent_fits_into_thirty_lines() -> None:
    (source,) = (source for name, source in PROGRAMS if name == "falling.py")
    assert len([line for line in source.splitlines() if line.strip()]) <= 30


def test_the_commands_of_the_page_play_five_right_episodes(folder: Path) -> None:
    for command in COMMANDS:
        called(folder, "-m", "evaluator", *shlex.split(command)[1:])
    grades = load_run(folder / "runs" / "falling").grades.values()
    assert [record.grade.strict for record in grades] == [Verdict.CORRECT] * 5
    assert len({str(record.answer_key) for record in grades}) == 5
    assert (folder / "runs" / "falling" / "report.html").is_file()


def test_the_second_program_prints_the_turns_and_the_verdict(folder: Path) -> None:
    lines = called(folder, "play_falling.py").splitlines()
    assert lines[0].endswith("['step', 'get_velocity']")
    assert lines[1].endswith("['answer']")
    assert lines[2] == "correct"
