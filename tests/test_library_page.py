"""Tests of the page on the packages as libraries: its examples run and print the shown output."""

import contextlib
import io
import re

import pytest

from tests.builders.paths import DOCS

PAGE = (DOCS / "how-to" / "use-as-a-library.md").read_text(encoding="utf-8")
PROGRAMS = {
    section.split("\n", 1)[0]: "\n".join(re.findall(r"^```python\n(.*?)^```", section, re.DOTALL | re.MULTILINE))
    for section in re.split(r"^## ", PAGE, flags=re.MULTILINE)[1:]
}
"""The blocks of each section, as one program."""


@pytest.mark.parametrize("section", PROGRAMS)
def test_the_examples_of_a_section_print_what_the_page_says(section: str) -> None:
    program = PROGRAMS[section]
    said = re.findall(r"# → (.+)$", program, re.MULTILINE)
    assert said
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(compile(program, section, "exec"), {"__name__": "example"})
    assert printed.getvalue().splitlines() == said
