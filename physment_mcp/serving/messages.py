"""Whether the body of a request is a JSON-RPC message, so that one that is not gets a sentence for an answer.

The MCP library would answer with the error of its validation: many lines that speak of its classes.
"""

from typing import Any, NamedTuple, cast

import mcp_types as types
from pydantic_core import from_json
from starlette.responses import JSONResponse

_ONE_OBJECT = 'a message is one JSON object, such as {"jsonrpc": "2.0", "id": 1, "method": "tools/list"}'


class Fault(NamedTuple):
    """What is wrong with a body."""

    code: int
    """Of JSON-RPC."""
    sentence: str

    def response(self) -> JSONResponse:
        """The answer to it."""
        error = {"code": self.code, "message": self.sentence}
        return JSONResponse({"jsonrpc": "2.0", "id": None, "error": error}, status_code=400)


def fault_of(body: bytes) -> Fault | None:
    """What is wrong with the body of a request; None if it is a message."""
    try:
        message: Any = from_json(body)
    except ValueError as error:
        return Fault(types.PARSE_ERROR, f"this is not JSON: {error}")
    if not isinstance(message, dict):
        return Fault(types.INVALID_REQUEST, _ONE_OBJECT)
    fields = cast("dict[str, Any]", message)
    wrong = _wrong_request(fields) if "method" in fields else _wrong_response(fields)
    if fields.get("jsonrpc") != "2.0":
        wrong = '`jsonrpc` must be "2.0"'
    return Fault(types.INVALID_REQUEST, wrong) if wrong else None


def _wrong_request(fields: dict[str, Any]) -> str:
    if not isinstance(fields["method"], str):
        return "`method` must be a text, such as tools/list"
    if not isinstance(fields.get("params"), dict | None):
        return "`params` must be an object"
    return "" if "id" not in fields or _is_id(fields["id"]) else "`id` must be a whole number or a text"


def _wrong_response(fields: dict[str, Any]) -> str:
    error = fields.get("error")
    if isinstance(error, dict):
        named = cast("dict[str, Any]", error)
        well = isinstance(named.get("code"), int) and isinstance(named.get("message"), str)
    else:
        well = isinstance(fields.get("result"), dict)
    return "" if well and _is_id(fields.get("id")) else _ONE_OBJECT


def _is_id(value: Any) -> bool:
    return isinstance(value, str) or (isinstance(value, int) and not isinstance(value, bool))
