"""The page that compares the project with the paper: complete, and naming only what exists."""

import re

from tests.builders.paths import DOCS, ROOT

PAGE = DOCS / "explanation" / "the-paper.md"
STATUS = {"as in the paper", "as in the paper, and more", "different", "not here"}


def rows() -> list[list[str]]:
    lines = re.findall(r"^\| \d.*\|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def test_every_statement_has_a_row_and_a_status() -> None:
    found = rows()
    assert [row[0] for row in found] == [str(number) for number in range(1, 151)]
    assert {row[2] for row in found} == STATUS
    assert len({row[1] for row in found}) == len(found)


def test_what_is_different_or_not_here_is_argued_for() -> None:
    for row in rows():
        if row[2] in {"different", "not here"}:
            assert len(row[3]) > 40, row


def test_every_place_named_exists() -> None:
    for row in rows():
        (target,) = re.findall(r"\]\(([^)]+)\)", row[4])
        assert (PAGE.parent / target).resolve().is_relative_to(ROOT), row
        assert (PAGE.parent / target).exists(), row


def test_the_numbers_in_its_introduction_are_those_of_its_rows() -> None:
    text, found = PAGE.read_text(encoding="utf-8"), rows()
    for status in STATUS:
        count = sum(row[2] == status for row in found)
        words = {"different": "different on purpose", "as in the paper, and more": "as in the paper and more"}
        assert re.search(rf"\b{count}\s{words.get(status, status)}", text), status
