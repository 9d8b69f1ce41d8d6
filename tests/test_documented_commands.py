"""Tests that every command line on a page is accepted by its program, and that every make target exists."""

import contextlib
import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from evaluator.commands.program import parsed
from physment_mcp.commands.program import parser
from tests.builders.paths import DOCS, ROOT

PAGES = (ROOT / "README.md", *sorted(DOCS.rglob("*.md")))
STUDY = re.compile(r"```toml file=study\.toml\n(.*?)```", re.DOTALL)


def lines_of(page: Path) -> Iterator[str]:
    """Return the lines of the shell blocks of a page; a line that ends with a backslash continues in the next."""
    for block in re.findall(r"```sh[^\n]*\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL):
        yield from block.replace("\\\n", " ").splitlines()


def shown(program: str) -> list[tuple[str, str]]:
    """Return each page that shows a command of a program, with the arguments but without variable assignments."""
    command = re.compile(rf"^\s*(?:\w+=\S+ )*(?:\.venv/bin/|uvx (?:--from \S+ )?|pipx run --spec \S+ )?{program} (.*)$")
    return [
        (page.relative_to(ROOT).as_posix(), found[1])
        for page in PAGES
        for line in lines_of(page)
        if (found := command.match(line))
    ]


def test_pages_show_the_commands_of_the_laboratory() -> None:
    assert {shlex.split(line, comments=True)[0] for _, line in shown("physment-mcp")} >= {"serve", "config", "export"}


@pytest.mark.parametrize(("page", "line"), shown("physment-mcp"))
def test_a_shown_command_of_the_laboratory_is_accepted(page: str, line: str) -> None:
    assert parser().parse_args(shlex.split(line, comments=True)).run


@pytest.mark.parametrize(("page", "line"), shown("physment-eval"))
def test_a_shown_command_of_the_evaluator_is_accepted(page: str, line: str, tmp_path: Path) -> None:
    """Parses the command in a folder whose `study.toml` is the study that the page shows, if it shows one."""
    for study in STUDY.findall((ROOT / page).read_text(encoding="utf-8")):
        (tmp_path / "study.toml").write_text(study, encoding="utf-8")
    with contextlib.chdir(tmp_path):
        assert parsed(shlex.split(line, comments=True)).run


@pytest.mark.parametrize(("page", "target"), shown("make"))
def test_a_shown_make_target_exists(page: str, target: str) -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for name in shlex.split(target, comments=True):
        if "=" in name:
            continue  # a variable, such as ENGINES="4.0.0"
        assert re.search(rf"^{name}:", makefile, re.MULTILINE)
