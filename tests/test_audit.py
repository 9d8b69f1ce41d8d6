"""Tests that the evidence of the audit exists, and that its page is current."""

import pytest

from tests.harness.audit import CHECKLISTS, PAGE, Row, faults, page


@pytest.mark.parametrize(
    "row", [row for rows in CHECKLISTS.values() for row in rows], ids=lambda row: f"{row.item} {row.asks}"
)
def test_the_evidence_of_a_row_exists(row: Row) -> None:
    assert faults(row) == []


@pytest.mark.parametrize(
    ("row", "fault"),
    [
        (
            Row(item="X", asks="a", status="met", evidence=("tests/test_audit.py::test_that_vanished",)),
            "does not exist",
        ),
        (Row(item="X", asks="a", status="met", evidence=("docs/vanished.md",)), "does not exist"),
        (Row(item="X", asks="a", status="met", evidence=("physment-eval vanish",)), "does not exist"),
        (Row(item="X", asks="a", status="met", evidence=("python -m tests.harness.vanished",)), "does not exist"),
        (Row(item="X", asks="a", status="met"), "met without evidence"),
        (Row(item="X", asks="a", status="not met"), "without a reason"),
    ],
)
def test_a_row_without_what_it_needs_is_found(row: Row, fault: str) -> None:
    (sentence,) = faults(row)
    assert fault in sentence


def test_the_page_is_current() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "run python -m tests.harness.audit"


def test_the_checklists_are_complete() -> None:
    items = [row.item for row in CHECKLISTS["abc"]]
    assert len(set(items)) == len(items)
    assert {f"T.{number}" for number in range(1, 11)} | {f"R.{number}" for number in range(1, 14)} <= set(items)
    assert len(CHECKLISTS["betterbench"]) == 47
    assert [row.item for row in CHECKLISTS["benchjack"]] == [f"V{number}" for number in range(1, 9)]
