"""Tests of Markdown tables: their form, and escaping of texts."""

import re

import pytest

from evaluator.report.export import escaped, markdown_table


def test_a_table_has_titles_a_rule_and_a_line_for_each_row() -> None:
    assert markdown_table(("a", "b"), [("1", "2"), ("3", "4")]) == "| a | b |\n|---|---|\n| 1 | 2 |\n| 3 | 4 |"


def test_numbers_are_aligned_to_the_right_after_the_first_column() -> None:
    assert markdown_table(("a", "b", "c"), [], numbers=True) == "| a | b | c |\n|---|---:|---:|"


def test_a_bar_in_a_cell_opens_no_column() -> None:
    last = markdown_table(("a|b", "c"), [("x | y", escaped(r"\|"))]).splitlines()[-1]
    assert last == r"| x \| y | \\\| |"
    assert len(re.findall(r"(?<!\\)(?:\\\\)*\|", last)) == 3


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("kg*m^2", r"kg\*m^2"),
        ("two\nlines\u2028and  more", "two lines and more"),
        ("<b> & [x](y) `z` _u_ #1", r"&lt;b\> & \[x\](y) \`z\` \_u\_ \#1"),
        ("plain, words; 1.5 m/s", "plain, words; 1.5 m/s"),
    ],
)
def test_escaped_text_is_one_line_without_markup(text: str, expected: str) -> None:
    assert escaped(text) == expected
