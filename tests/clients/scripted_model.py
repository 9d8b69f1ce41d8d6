"""A model provider on loopback that knows by heart how to play: it answers as a pack's own protocol would.

It speaks OpenAI's chat completions and Gemini's generateContent, so that each client runs as it would with a real
model. It keeps no state: what it says next follows from the conversation that it is sent. One call at a time, because
clients run the calls of one reply side by side, and the order would be anybody's guess. Its first calls
are wrong ones: an agent learns from refusals, also from several on end, so it goes on only if it is told why.
"""

import contextlib
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
from starlette.responses import JSONResponse
from starlette.routing import Route

from scenes import list_packs, read_pack
from scenes.protocol import Call, Reading, load_solution

KEY = "no-key-at-all"
WRONG = Call("get_position", {"object_id": "object_99"})
"""A call that every scene refuses, naming the object."""
WRONG_CALLS = 3
_DONE = "The answer is given."


@dataclass(frozen=True, slots=True)
class Asked:
    """A conversation, in no provider's words."""

    task: str
    """All that was said before the model's first reply."""
    returns: tuple[Any, ...]
    """What came back after each of the model's replies, however the client wrapped it."""
    tools: frozenset[str]


def next_call(asked: Asked) -> Call | None:
    """What to call next: the wrong calls, then what the protocol of the scene calls; None at its end.

    Raises:
        ValueError: No scene is told of, it was not told why a call was refused, or what it read makes no sense.
    """
    readings = [reading(one) for one in asked.returns]
    for refusal in readings[:WRONG_CALLS]:
        if "object_99" not in refusal.get("error", ""):
            raise ValueError(f"the model was not told why its call was refused, but: {json.dumps(refusal)[:200]}")
    if len(readings) < WRONG_CALLS:
        return WRONG
    readings = readings[WRONG_CALLS:]
    protocol = _solver(asked.task)(asked.task)
    batch, taken = next(protocol), readings
    try:
        while len(readings) >= len(batch):
            taken, readings = readings[: len(batch)], readings[len(batch) :]
            batch = protocol.send(taken)
    except StopIteration:
        return None
    except (LookupError, TypeError) as error:
        raise ValueError(f"the protocol makes nothing of {json.dumps(taken)[:300]}") from error
    return batch[len(readings)]


def _solver(task: str) -> Any:
    named = re.search(r"# Scene: (.*)", task)
    for files in list_packs():
        if named and read_pack(files).metadata.scene_name == named[1].strip():
            return load_solution(files).solve
    raise ValueError(f"the conversation tells of no scene: {task[:200]!r}")


def reading(returned: Any) -> Reading:
    """The structured result in whatever a client made of it: text, parts of text, text around JSON."""
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
    """The JSON objects and lists that stand in a text, outermost first."""
    found: list[Any] = []
    at = 0
    while (start := re.compile(r"[\[{]").search(text, at)) is not None:
        try:
            value, at = json.JSONDecoder().raw_decode(text, start.start())
            found.append(value)
        except ValueError:
            at = start.end()
    return found


def read_openai(body: Mapping[str, Any]) -> Asked:
    """A request for a chat completion."""
    said, returns = _split(
        [(one["role"] == "assistant", one.get("content")) for one in body["messages"]],
    )
    return Asked(_text(said), returns, frozenset(one["function"]["name"] for one in body.get("tools") or ()))


def read_gemini(body: Mapping[str, Any]) -> Asked:
    """A request for generateContent."""
    said, returns = _split(
        [
            (one.get("role") == "model", [part.get("functionResponse") or part.get("text") for part in one["parts"]])
            for one in body["contents"]
        ],
    )
    declared = [one for group in body.get("tools") or () for one in group.get("functionDeclarations", ())]
    return Asked(_text(said), returns, frozenset(one["name"] for one in declared))


def _split(messages: Sequence[tuple[bool, Any]]) -> tuple[list[Any], tuple[Any, ...]]:
    """What was said before the model's first reply, and what came after each of its replies."""
    before: list[Any] = []
    after: list[list[Any]] = []
    for ours, content in messages:
        if ours:
            after.append([])
        else:
            (after[-1] if after else before).append(content)
    return before, tuple(one[0] if len(one) == 1 else one for one in after if one)


def _text(contents: Any) -> str:
    match contents:
        case str():
            return contents
        case {"text": text}:
            return _text(text)
        case list() | tuple():
            return "\n\n".join(_text(one) for one in contents)
        case _:
            return ""


async def _openai(request: Request) -> JSONResponse:
    body = await request.json()
    if body.get("stream"):
        return JSONResponse({"error": {"message": "this model does not stream", "type": "no_stream"}}, 400)
    asked = read_openai(body)
    call, words = _reply(asked)
    message: dict[str, Any] = {"role": "assistant", "content": None if call else words}
    if call:
        function = {"name": call.tool, "arguments": json.dumps(call.arguments)}
        message["tool_calls"] = [{"id": f"call_{len(asked.returns)}", "type": "function", "function": function}]
    return JSONResponse(
        {
            "id": f"chatcmpl-{len(asked.returns)}",
            "object": "chat.completion",
            "created": int(time.time()),
            "model": body.get("model", ""),
            "choices": [{"index": 0, "message": message, "finish_reason": "tool_calls" if call else "stop"}],
            "usage": {"prompt_tokens": 1, "completion_tokens": 1, "total_tokens": 2},
        }
    )


async def _gemini(request: Request) -> JSONResponse:
    call, words = _reply(read_gemini(await request.json()))
    part = {"functionCall": {"name": call.tool, "args": call.arguments}} if call else {"text": words}
    return JSONResponse(
        {
            "candidates": [{"content": {"role": "model", "parts": [part]}, "finishReason": "STOP", "index": 0}],
            "usageMetadata": {"promptTokenCount": 1, "candidatesTokenCount": 1, "totalTokenCount": 2},
            "modelVersion": "scripted",
        }
    )


def _reply(asked: Asked) -> tuple[Call | None, str]:
    """The call to make, or what to say instead."""
    try:
        call, words = next_call(asked), _DONE
    except ValueError as error:
        call, words = None, str(error)
    if call is None and "final_answer" in asked.tools:
        # Some clients take a reply without a call for a mistake, and offer a tool of their own to end with.
        call = Call("final_answer", {"answer": words})
    return call, words


def app() -> Starlette:
    """The provider."""
    return Starlette(
        routes=[
            Route("/v1/chat/completions", _openai, methods=["POST"]),
            Route("/v1beta/models/{model:path}", _gemini, methods=["POST"]),
        ]
    )


@contextlib.contextmanager
def serving(application: Any) -> Generator[str]:
    """Serve an ASGI application from a thread, on loopback; its address."""
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
