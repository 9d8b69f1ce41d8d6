"""Every command line of the laboratory that a page shows is one it takes."""

import re
import shlex

import pytest

from physment_mcp.__main__ import parser
from tests.builders.paths import ROOT

SHOWN = [
    (page.name, line.strip())
    for page in (ROOT / "README.md", *(ROOT / "docs" / "how-to").glob("*.md"))
    for block in re.findall(r"```sh\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    for line in block.splitlines()
    if re.match(r"(\.venv/bin/)?physment-mcp\b", line.strip())
]


def test_pages_show_the_commands_of_the_laboratory() -> None:
    assert {shlex.split(line, comments=True)[1] for _, line in SHOWN} >= {"serve", "config", "export"}


@pytest.mark.parametrize(("page", "line"), SHOWN)
def test_a_shown_command_is_one_it_takes(page: str, line: str) -> None:
    assert parser().parse_args(shlex.split(line, comments=True)[1:]).run
