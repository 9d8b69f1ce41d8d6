"""Tests that the references of the command lines and of the public names match the code."""

from collections.abc import Callable

import pytest

import evaluator
import physment_mcp
import scenes
from tests.builders.api_reference import api_page
from tests.builders.cli_reference import cli_page
from tests.builders.paths import DOCS


@pytest.mark.parametrize(
    ("name", "made"),
    [("cli", cli_page), ("api", lambda: api_page((physment_mcp, evaluator, scenes)))],
    ids=["commands", "names"],
)
def test_a_reference_page_is_current(name: str, made: Callable[[], str], update_goldens: bool) -> None:
    page, text = DOCS / "reference" / f"{name}.md", made()
    if update_goldens:
        page.write_text(text, encoding="utf-8")
    assert page.read_text(encoding="utf-8") == text
