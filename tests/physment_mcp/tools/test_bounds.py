"""Tests that oversized calls are refused with one sentence before their arguments are read, and change nothing."""

from typing import Any

import pytest

from physment_mcp.errors import BadArgument
from physment_mcp.scene import load_scene
from physment_mcp.session import Session
from physment_mcp.tools.calls import (
    MAX_ARGUMENTS,
    MAX_CALL_BYTES,
    MAX_NAME,
    MAX_NESTING,
    MAX_VALUES,
    call,
    excess,
)


def nested(levels: int) -> Any:
    value: Any = 1
    for _ in range(levels):
        value = [value]
    return value


@pytest.mark.parametrize(
    ("name", "arguments", "sentence"),
    [
        ("s" * (MAX_NAME + 1), {}, "the name of a tool has at most 64 characters, not 65"),
        ("step", {str(number): 1 for number in range(MAX_ARGUMENTS + 1)}, "a call has at most 32 arguments, not 33"),
        ("step", {"x" * (MAX_CALL_BYTES + 1): 1}, "hold at most 20000 bytes of text"),
        ("step", {"duration": "\u00e9" * (MAX_CALL_BYTES // 2 + 1)}, "hold at most 20000 bytes of text"),
        ("step", {str(number): 10**4000 for number in range(6)}, "hold at most 20000 bytes of text"),
        ("step", {"duration": [-(10**4000)] * 6}, "hold at most 20000 bytes of text"),
        ("step", {"duration": [0] * (MAX_VALUES + 1)}, "hold at most 4000 values"),
        ("step", {"duration": [{"a": [0] * MAX_VALUES}]}, "hold at most 4000 values"),
        ("step", {"duration": nested(MAX_NESTING + 1)}, "nest at most 16 levels"),
        ("step", {"duration": nested(900)}, "nest at most 16 levels"),
    ],
)
def test_a_call_that_is_too_large_is_refused_in_one_sentence(
    name: str, arguments: dict[str, Any], sentence: str
) -> None:
    session = Session(load_scene(7))
    before = session.state
    with pytest.raises(BadArgument, match=sentence) as refusal:
        call(session, name, arguments)
    assert len(str(refusal.value)) < 200
    assert session.state is before
    assert session.calls == 1


@pytest.mark.parametrize(
    "arguments",
    [
        {},
        {"answer": "x" * (MAX_CALL_BYTES - len("answer"))},
        {"answer": [0.5] * 1000, "steps": {f"s{number}": 1.0 for number in range(100)}},
        {"duration": nested(MAX_NESTING - 1)},
        {"duration": [2**64 - 1] * 1000},
        {"answer": 10**4000},
    ],
)
def test_what_a_tool_may_accept_is_not_too_large(arguments: dict[str, Any]) -> None:
    assert excess("answer", arguments) == ""
