"""The wire formats of command-line coding agents: Anthropic's messages and OpenAI's responses, both as streams.

These agents put a prefix before the names of a server's tools, so a call is sent under the name that the request lists.
"""

import json
from collections.abc import Iterable, Mapping
from typing import Any

from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from scenes.protocol import Call
from tests.harness.clients.scripted_model import Conversation, joined_text, reply_to, split_at_replies

_SERVER = "mcp__physment"
"""Prefix that Claude Code and Codex put before the names of the tools of the server `physment`."""


def read_messages_request(body: Mapping[str, Any]) -> Conversation:
    """Parse a request for a message of Anthropic's API."""
    said, returns = split_at_replies(
        [(message["role"] == "assistant", message["content"]) for message in body["messages"]]
    )
    return Conversation(joined_text(said), returns, frozenset(tool["name"] for tool in body.get("tools") or ()))


def read_response_request(body: Mapping[str, Any]) -> Conversation:
    """Parse a request for a response of OpenAI's API. A tool search does not count as a scripted reply."""
    items = [item for item in body["input"] if item["type"] in {"message", "function_call", "function_call_output"}]
    said, returns = split_at_replies(
        [
            (
                item["type"] == "function_call" or item.get("role") == "assistant",
                item.get("output", item.get("content")),
            )
            for item in items
        ]
    )
    found = [tool for item in body["input"] if item["type"] == "tool_search_output" for tool in item["tools"]]
    return Conversation(joined_text(said), returns, frozenset(tool.get("name", "") for tool in found))


def _stream(events: Iterable[Mapping[str, Any]]) -> Response:
    lines = (f"event: {event['type']}\ndata: {json.dumps(event)}\n\n" for event in events)
    return Response("".join(lines), media_type="text/event-stream")


async def _messages(request: Request) -> Response:
    body = await request.json()
    conversation = read_messages_request(body)
    call, words = reply_to(conversation)
    block: dict[str, Any] = {"type": "text", "text": ""}
    delta: dict[str, Any] = {"type": "text_delta", "text": words}
    if call:
        block = {
            "type": "tool_use",
            "id": f"toolu_{len(conversation.returns)}",
            "name": f"{_SERVER}__{call.tool}",
            "input": {},
        }
        delta = {"type": "input_json_delta", "partial_json": json.dumps(call.arguments)}
    usage = {"input_tokens": 1, "output_tokens": 1}
    # Claude Code takes messages with one id for parts of one message.
    message: dict[str, Any] = {"id": f"msg_{len(body['messages'])}", "type": "message", "role": "assistant"}
    message |= {"model": body["model"], "content": []}
    message |= {"stop_reason": None, "stop_sequence": None, "usage": usage}
    end = {"stop_reason": "tool_use" if call else "end_turn", "stop_sequence": None}
    return _stream(
        [
            {"type": "message_start", "message": message},
            {"type": "content_block_start", "index": 0, "content_block": block},
            {"type": "content_block_delta", "index": 0, "delta": delta},
            {"type": "content_block_stop", "index": 0},
            {"type": "message_delta", "delta": end, "usage": usage},
            {"type": "message_stop"},
        ]
    )


async def _responses(request: Request) -> Response:
    body = await request.json()
    conversation = read_response_request(body)
    call, words = reply_to(conversation)
    number = len(conversation.returns)
    ident = f"resp_{len(body['input'])}"
    item = _search(number) if call and not conversation.tools else _item(call, words, number)
    usage = {"input_tokens": 1, "output_tokens": 1, "total_tokens": 2}
    return _stream(
        [
            {"type": "response.created", "response": {"id": ident}},
            {"type": "response.output_item.done", "output_index": 0, "item": item},
            {"type": "response.completed", "response": {"id": ident, "output": [item], "usage": usage}},
        ]
    )


def _search(number: int) -> dict[str, Any]:
    """Return a search for the laboratory's tools. Codex lists them only after a search."""
    arguments = {"query": "physment laboratory step answer", "limit": 30}
    return {"type": "tool_search_call", "call_id": f"search_{number}", "execution": "client", "arguments": arguments}


def _item(call: Call | None, words: str, number: int) -> dict[str, Any]:
    if call is None:
        content = [{"type": "output_text", "text": words, "annotations": []}]
        return {"type": "message", "id": "msg_1", "role": "assistant", "status": "completed", "content": content}
    return {
        "type": "function_call",
        "id": f"fc_{number}",
        "call_id": f"call_{number}",
        "namespace": _SERVER,
        "name": call.tool,
        "arguments": json.dumps(call.arguments),
        "status": "completed",
    }


async def _no_tokens(_request: Request) -> Response:
    return JSONResponse({"input_tokens": 1})


ROUTES = (
    Route("/v1/messages", _messages, methods=["POST"]),
    Route("/v1/messages/count_tokens", _no_tokens, methods=["POST"]),
    Route("/v1/responses", _responses, methods=["POST"]),
)
"""Routes of a provider for coding agents, in addition to chat completions and generateContent."""
