"""A model provider on loopback that plays the reference protocol of a pack.

It implements OpenAI's chat completions and Gemini's generateContent, so that each client runs as with a real model. The
provider keeps no state: it derives the next reply from the conversation in the request. Each reply has one call,
because clients run several calls in parallel, in an unpredictable order. The first three calls are deliberately wrong.
The provider continues only if the client passes on the reason of each refusal, because agents need it.
"""

import contextlib
import functools
import hashlib
import json
import re
import threading
import time
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route

from scenes import PackFiles, list_packs, read_pack
from scenes.protocol import Call, Reading, load_solution

KEY = "no-key-at-all"
WRONG = Call("get_position", {"object_id": "object_99"})
"""A call that every scene refuses; the refusal names the object."""
WRONG_CALLS = 3
_USAGE = {"prompt_tokens": 1, "completion_tokens": 1, "total_tokens": 2}
_DONE = "The answer is given."
_WAITING: dict[bytes, tuple[Any, Sequence[Call], int]] = {}
"""Conversation → its suspended protocol, the last calls that it requested, and the number of results before them."""
_MOST_WAITING = 1000


@dataclass(frozen=True, slots=True)
class Conversation:
    """A conversation, independent of the provider's format."""

    task: str
    """All text before the model's first reply."""
    returns: tuple[Any, ...]
    """The result after each reply of the model, as the client wrapped it."""
    tools: frozenset[str]


def next_call(conversation: Conversation) -> Call | None:
    """Return the next call: first the wrong calls, then those of the scene's protocol; None at the end.

    Raises:
        ValueError: The conversation names no scene, a refusal gives no reason, or a result cannot be parsed.
    """
    readings = [reading(returned) for returned in conversation.returns]
    for refusal in readings[:WRONG_CALLS]:
        if "object_99" not in refusal.get("error", ""):
            raise ValueError(f"the client did not return why a call was refused, but: {json.dumps(refusal)[:200]}")
    if len(readings) < WRONG_CALLS:
        return WRONG
    readings = readings[WRONG_CALLS:]
    # A protocol that waits here can be continued once, so a second conversation with the same results starts a new one.
    protocol, batch, used = _WAITING.pop(_place(conversation.task, readings[:-1]), (None, (), 0))
    if protocol is None:
        protocol = _solver(conversation.task)(conversation.task)
        batch = next(protocol)
    taken, left = readings, readings[used:]
    try:
        while len(left) >= len(batch):
            taken, left = left[: len(batch)], left[len(batch) :]
            used += len(batch)
            batch = protocol.send(taken)
    except StopIteration:
        return None
    except (LookupError, TypeError) as error:
        raise ValueError(f"the protocol cannot use {json.dumps(taken)[:300]}") from error
    _WAITING[_place(conversation.task, readings)] = protocol, batch, used
    while len(_WAITING) > _MOST_WAITING:
        _WAITING.pop(next(iter(_WAITING)), None)
    return batch[len(left)]


def _place(task: str, readings: Sequence[Reading]) -> bytes:
    """Identify a conversation up to its last result."""
    return hashlib.sha256(json.dumps([task, readings]).encode()).digest()


def _solver(task: str) -> Any:
    named = re.search(r"# Scene: (.*)", task)
    files = _packs().get(named[1].strip()) if named else None
    if files is None:
        raise ValueError(f"the conversation names no scene: {task[:200]!r}")
    return load_solution(files).solve


@functools.cache
def _packs() -> Mapping[str, PackFiles]:
    """Name of a scene → its pack."""
    return {read_pack(files).metadata.scene_name: files for files in list_packs()}


def reading(returned: Any) -> Reading:
    """Extract the structured result from a client's representation: text, parts of text, or text around JSON."""
    found = _result_in(returned)
    return found if found is not None else {"error": returned if isinstance(returned, str) else json.dumps(returned)}


def _result_in(value: Any) -> Reading | None:
    match value:
        case {"sim_time": _}:
            return value
        case str():
            parts: Sequence[Any] = _json_in(value)
        case Mapping():
            parts = tuple(value.values())
        case list() | tuple():
            parts = value
        case _:
            return None
    return next((found for part in parts if (found := _result_in(part)) is not None), None)


def _json_in(text: str) -> list[Any]:
    """The outermost JSON objects and lists in a text."""
    found: list[Any] = []
    at = 0
    while (start := re.compile(r"[\[{]").search(text, at)) is not None:
        try:
            value, at = json.JSONDecoder().raw_decode(text, start.start())
            found.append(value)
        except ValueError:
            at = start.end()
    return found


def read_openai(body: Mapping[str, Any]) -> Conversation:
    """Parse a request for a chat completion."""
    said, returns = split_at_replies(
        [(message["role"] == "assistant", message.get("content")) for message in body["messages"]],
    )
    return Conversation(
        joined_text(said), returns, frozenset(tool["function"]["name"] for tool in body.get("tools") or ())
    )


def read_gemini(body: Mapping[str, Any]) -> Conversation:
    """Parse a request for generateContent."""
    said, returns = split_at_replies(
        [
            (
                message.get("role") == "model",
                [part.get("functionResponse") or part.get("text") for part in message["parts"]],
            )
            for message in body["contents"]
        ],
    )
    tools = [tool for group in body.get("tools") or () for tool in group.get("functionDeclarations", ())]
    return Conversation(joined_text(said), returns, frozenset(tool["name"] for tool in tools))


def split_at_replies(messages: Sequence[tuple[bool, Any]]) -> tuple[list[Any], tuple[Any, ...]]:
    """Split the contents at the model's replies: those before the first reply, and those after each reply."""
    before: list[Any] = []
    after: list[list[Any]] = []
    for ours, content in messages:
        if ours:
            after.append([])
        else:
            (after[-1] if after else before).append(content)
    return before, tuple(contents[0] if len(contents) == 1 else contents for contents in after if contents)


def joined_text(contents: Any) -> str:
    match contents:
        case str():
            return contents
        case {"text": text}:
            return joined_text(text)
        case list() | tuple():
            return "\n\n".join(map(joined_text, contents))
        case _:
            return ""


async def _openai(request: Request) -> Response:
    body = await request.json()
    conversation = read_openai(body)
    call, words = reply_to(conversation)
    message: dict[str, Any] = {"role": "assistant", "content": None if call else words}
    if call:
        function = {"name": call.tool, "arguments": json.dumps(call.arguments)}
        message["tool_calls"] = [{"id": f"call_{len(conversation.returns)}", "type": "function", "function": function}]
    return completed(body, message)


def completed(body: Mapping[str, Any], message: Mapping[str, Any]) -> Response:
    """The reply to a request of chat completions, as a stream if it asks for one."""
    finish = "tool_calls" if message.get("tool_calls") else "stop"
    if body.get("stream"):
        return _streamed(message, finish)
    return JSONResponse(
        {
            "id": "chatcmpl-s",
            "object": "chat.completion",
            "created": int(time.time()),
            "model": body.get("model", ""),
            "choices": [{"index": 0, "message": message, "finish_reason": finish}],
            "usage": _USAGE,
        }
    )


def _streamed(message: Mapping[str, Any], finish: str) -> Response:
    """Format a chat completion as server-sent events: the whole message, the finish reason, the usage."""
    calls = [{"index": number, **call} for number, call in enumerate(message.get("tool_calls", ()))]
    delta = {**message, "tool_calls": calls} if calls else message
    events = [
        {"choices": [{"index": 0, "delta": delta, "finish_reason": None}]},
        {"choices": [{"index": 0, "delta": {}, "finish_reason": finish}]},
        {"choices": [], "usage": _USAGE},
    ]
    common = {"id": "chatcmpl-s", "object": "chat.completion.chunk", "created": int(time.time()), "model": "scripted"}
    lines = [json.dumps(common | event) for event in events]
    return Response("".join(f"data: {line}\n\n" for line in [*lines, "[DONE]"]), media_type="text/event-stream")


async def _gemini(request: Request) -> JSONResponse:
    call, words = reply_to(read_gemini(await request.json()))
    part = {"functionCall": {"name": call.tool, "args": call.arguments}} if call else {"text": words}
    return JSONResponse(
        {
            "candidates": [{"content": {"role": "model", "parts": [part]}, "finishReason": "STOP", "index": 0}],
            "usageMetadata": {"promptTokenCount": 1, "candidatesTokenCount": 1, "totalTokenCount": 2},
            "modelVersion": "scripted",
        }
    )


def reply_to(conversation: Conversation) -> tuple[Call | None, str]:
    """The call to make, or the text of a reply without a call."""
    try:
        call, words = next_call(conversation), _DONE
    except ValueError as error:
        call, words = None, str(error)
    if call is None and "final_answer" in conversation.tools:
        # Some clients treat a reply without a call as an error, and have their own tool to end the run.
        call = Call("final_answer", {"answer": words})
    return call, words


def app(*more: Route) -> Starlette:
    """Create the provider; `more` adds routes for other wire formats."""
    return Starlette(
        routes=[
            Route("/v1/chat/completions", _openai, methods=["POST"]),
            Route("/v1beta/models/{model:path}", _gemini, methods=["POST"]),
            *more,
        ]
    )


@contextlib.contextmanager
def serving(application: Any) -> Generator[str]:
    """Serve an ASGI application from a thread, on loopback; yields its address."""
    server = uvicorn.Server(uvicorn.Config(application, port=0, log_level="warning"))
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    try:
        yield f"http://127.0.0.1:{server.servers[0].sockets[0].getsockname()[1]}"
    finally:
        server.should_exit = True
        thread.join()
