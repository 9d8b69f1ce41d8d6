"""Tests that every JSON-RPC message is accepted, and any other body is refused with one short sentence."""

import json

import pytest

from physment_mcp.serving.http_guard import fault_of


@pytest.mark.parametrize(
    "body",
    [
        *(b"", b"{", b"\xff", b"NaN,", b'{"a": 1e}', b"[" * 900),
        *(b"[]", b"7", b'"step"', b"null", b"{}", b'[{"jsonrpc": "2.0", "id": 1, "method": "ping"}]'),
        *(b'{"id": 1, "method": "ping"}', b'{"jsonrpc": "1.0", "id": 1, "method": "ping"}'),
        *(b'{"jsonrpc": "2.0", "id": 1, "method": 7}', b'{"jsonrpc": "2.0", "id": 1, "method": "ping", "params": []}'),
        *(b'{"jsonrpc": "2.0", "id": 1.5, "method": "ping"}', b'{"jsonrpc": "2.0", "id": true, "method": "ping"}'),
        *(b'{"jsonrpc": "2.0", "id": 1, "result": 7}', b'{"jsonrpc": "2.0", "id": 1, "error": {"code": "x"}}'),
    ],
)
def test_what_is_no_message_gets_one_short_sentence(body: bytes) -> None:
    fault = fault_of(body)
    assert fault is not None
    assert fault.sentence.isprintable()
    assert len(fault.sentence) < 200
    answer = json.loads(bytes(fault.response().body))
    assert answer == {"jsonrpc": "2.0", "id": None, "error": {"code": fault.code, "message": fault.sentence}}


@pytest.mark.parametrize(
    "message",
    [
        {"id": 1, "method": "ping"},
        {"id": "a", "method": "ping", "params": {}},
        {"id": 1, "method": "ping", "params": None},
        {"method": "notifications/initialized"},
        {"id": 1, "result": {}},
        {"id": 1, "error": {"code": 1, "message": "x"}},
    ],
)
def test_a_message_has_no_fault(message: dict[str, object]) -> None:
    assert fault_of(json.dumps({"jsonrpc": "2.0", **message}).encode()) is None
