"""Tests that refusals are one short printable sentence, whatever a client wrote."""

import pytest

from physment_mcp.errors import UnknownObject, quoted


@pytest.mark.parametrize("text", ["", "object_1", "it's", 'say "no"', "two\nlines", "x" * 64])
def test_a_short_text_is_quoted_whole(text: str) -> None:
    assert quoted(text) == repr(text)


@pytest.mark.parametrize(
    "text", ["x" * 65, "\x01" * 64, "\U000e0001" * 64, "\ud800" * 64, "'" * 9000 + '"', "\n'" * 80]
)
def test_a_long_text_is_cut_and_what_cannot_be_printed_is_escaped(text: str) -> None:
    said = quoted(text)
    assert len(said) <= 66
    assert said[0] == said[-1]
    assert said.isprintable()


def test_the_longest_refusal_of_an_unknown_object_is_short() -> None:
    known = [f"{number:02}" + "x" * 38 for number in range(64)]
    assert len(str(UnknownObject("\U000e0001" * 64, known))) < 1000
