"""Model providers on loopback: an HTTP server that implements three wire formats with scripted replies.

Like the real services, it rejects invalid requests, for example a history in which a tool call has no result.
"""

import itertools
import json
from abc import ABC, abstractmethod
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import anyio
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.types import Receive, Scope, Send

KEY = "sk-loopback-7Hq2-never-to-be-seen"
Calls = Sequence[tuple[str, Any]]


@dataclass
class Say:
    """A model's reply, independent of the provider's wire format."""

    text: str = ""
    calls: Calls = ()
    thought: str = ""
    finish: str = ""
    """The provider's finish reason; empty for the default."""
    extra: dict[str, Any] = field(default_factory=dict)
    """Fields that override top-level fields of the response body."""


@dataclass
class Computed:
    """A reply computed from the request."""

    make: Callable[["Seen"], Say]


@dataclass
class Bare:
    """A scripted HTTP response that is not a reply of a model, such as a broken connection."""

    serve: Callable[[Scope, Receive, Send], Awaitable[None]]


Step = Say | Computed | Bare


@dataclass
class Seen:
    """A received request."""

    path: str
    headers: dict[str, str]
    body: dict[str, Any]
    returns: list[str]
    """Results of the calls of the previous turn, in order."""
    last: str
    """The last user message."""


class Dialect(ABC):
    """Wire format of one provider."""

    name = ""
    model = ""

    @abstractmethod
    def reply(self, say: Say) -> dict[str, Any]:
        """Format a complete reply."""

    @abstractmethod
    def problem(self, body: Mapping[str, Any]) -> str:
        """The reason why the real service would refuse a request; empty if it would accept it."""

    @abstractmethod
    def returns(self, body: Mapping[str, Any]) -> list[str]:
        """Return the results of the previous turn's calls, in order."""

    @abstractmethod
    def last(self, body: Mapping[str, Any]) -> str:
        """The last user message."""

    def error(self, status: int, message: str, code: str) -> dict[str, Any]:
        return {"error": {"message": message, "code": code, "type": code}}


class OpenAI(Dialect):
    name, model = "openai", "gpt-5.5"

    def reply(self, say: Say) -> dict[str, Any]:
        calls = [
            {
                "id": f"call_{number}",
                "type": "function",
                "function": {"name": tool, "arguments": given if isinstance(given, str) else json.dumps(given)},
            }
            for number, (tool, given) in enumerate(say.calls)
        ]
        message: dict[str, Any] = {"role": "assistant", "content": say.text or None}
        message |= {"reasoning_content": say.thought} if say.thought else {}
        message |= {"tool_calls": calls} if calls else {}
        return {
            "id": "chatcmpl-1",
            "object": "chat.completion",
            "created": 1_780_000_000,
            "model": "gpt-5.5",
            "choices": [
                {"index": 0, "message": message, "finish_reason": say.finish or ("tool_calls" if calls else "stop")}
            ],
            "usage": {
                "prompt_tokens": 1000,
                "completion_tokens": 100,
                "total_tokens": 1100,
                "prompt_tokens_details": {"cached_tokens": 600},
            },
        } | say.extra

    def problem(self, body: Mapping[str, Any]) -> str:
        open_calls: list[str] = []
        for message in body["messages"]:
            if message["role"] == "tool":
                if message["tool_call_id"] not in open_calls:
                    return f"no call {message['tool_call_id']}"
                open_calls.remove(message["tool_call_id"])
            elif open_calls:
                return f"calls without a return: {open_calls}"
            for call in message.get("tool_calls") or []:
                json.loads(call["function"]["arguments"])
                open_calls.append(call["id"])
        return f"calls without a return: {open_calls}" if open_calls else ""

    def returns(self, body: Mapping[str, Any]) -> list[str]:
        tail = itertools.takewhile(lambda one: one["role"] != "assistant", reversed(body["messages"]))
        return [one["content"] for one in tail if one["role"] == "tool"][::-1]

    def last(self, body: Mapping[str, Any]) -> str:
        return next(one["content"] for one in reversed(body["messages"]) if one["role"] == "user")


class OpenRouter(OpenAI):
    name, model = "openrouter", "deepseek/deepseek-r1"

    def reply(self, say: Say) -> dict[str, Any]:
        body = super().reply(say)
        body["provider"] = "SomeHost"
        body["choices"][0]["native_finish_reason"] = say.finish or "stop"
        message = body["choices"][0]["message"]
        if thought := message.pop("reasoning_content", None):
            message["reasoning"] = thought
            message["reasoning_details"] = [
                {"type": "reasoning.text", "text": thought, "format": "unknown", "index": 0, "signature": None}
            ]
        body["usage"]["cost"] = 0.0125
        return body


class Anthropic(Dialect):
    name, model = "anthropic", "claude-opus-4-7"

    def reply(self, say: Say) -> dict[str, Any]:
        blocks: list[dict[str, Any]] = []
        blocks += [{"type": "thinking", "thinking": say.thought, "signature": "c2ln"}] if say.thought else []
        blocks += [{"type": "text", "text": say.text}] if say.text else []
        blocks += [
            {"type": "tool_use", "id": f"toolu_{number}", "name": tool, "input": given}
            for number, (tool, given) in enumerate(say.calls)
        ]
        return {
            "id": "msg_1",
            "type": "message",
            "role": "assistant",
            "model": "claude-opus-4-7",
            "content": blocks,
            "stop_reason": say.finish or ("tool_use" if say.calls else "end_turn"),
            "stop_sequence": None,
            "usage": {"input_tokens": 400, "cache_read_input_tokens": 600, "output_tokens": 100},
        } | say.extra

    def problem(self, body: Mapping[str, Any]) -> str:
        open_calls: set[str] = set()
        for message in body["messages"]:
            blocks = message["content"] if isinstance(message["content"], list) else []
            if open_calls != {one["tool_use_id"] for one in blocks if one["type"] == "tool_result"}:
                return f"calls without a return: {open_calls}"
            if any(one["type"] == "text" and not one["text"].strip() for one in blocks):
                return "text content blocks must contain non-whitespace text"
            open_calls = {one["id"] for one in blocks if one["type"] == "tool_use"}
        return ""

    def returns(self, body: Mapping[str, Any]) -> list[str]:
        blocks = [one for one in body["messages"][-1]["content"] if one["type"] == "tool_result"]
        return [one["content"] if isinstance(one["content"], str) else one["content"][0]["text"] for one in blocks]

    def last(self, body: Mapping[str, Any]) -> str:
        content = body["messages"][-1]["content"]
        return content if isinstance(content, str) else [one["text"] for one in content if one["type"] == "text"][-1]

    def error(self, status: int, message: str, code: str) -> dict[str, Any]:
        return {"type": "error", "error": {"type": code, "message": message}}

    def stream(self, message: Mapping[str, Any]) -> str:
        """Format a message as server-sent events."""
        events: list[dict[str, Any]] = [
            {"type": "message_start", "message": {**message, "content": [], "stop_reason": None}}
        ]
        for index, block in enumerate(message["content"]):
            kind = block["type"]
            empty = {"text": {"text": ""}, "thinking": {"thinking": "", "signature": ""}, "tool_use": {"input": {}}}[
                kind
            ]
            deltas: list[dict[str, Any]] = {
                "text": lambda b: [{"type": "text_delta", "text": b["text"]}],
                "thinking": lambda b: [
                    {"type": "thinking_delta", "thinking": b["thinking"]},
                    {"type": "signature_delta", "signature": b["signature"]},
                ],
                "tool_use": lambda b: [
                    {
                        "type": "input_json_delta",
                        "partial_json": b["input"] if isinstance(b["input"], str) else json.dumps(b["input"]),
                    }
                ],
            }[kind](block)
            events.append({"type": "content_block_start", "index": index, "content_block": {**block, **empty}})
            events += [{"type": "content_block_delta", "index": index, "delta": one} for one in deltas]
            events.append({"type": "content_block_stop", "index": index})
        delta = {"stop_reason": message["stop_reason"], "stop_sequence": None}
        events += [{"type": "message_delta", "delta": delta, "usage": message["usage"]}, {"type": "message_stop"}]
        return "".join(f"event: {one['type']}\ndata: {json.dumps(one)}\n\n" for one in events)


class Google(Dialect):
    name, model = "google", "gemini-3.1-pro-preview"

    def reply(self, say: Say) -> dict[str, Any]:
        parts: list[dict[str, Any]] = []
        parts += [{"text": say.thought, "thought": True}] if say.thought else []
        parts += [{"text": say.text}] if say.text else []
        parts += [{"functionCall": {"name": tool, "args": given}} for tool, given in say.calls]
        candidate = {"content": {"role": "model", "parts": parts}, "finishReason": say.finish or "STOP", "index": 0}
        return {
            "candidates": [candidate],
            "usageMetadata": {
                "promptTokenCount": 1000,
                "candidatesTokenCount": 100,
                "cachedContentTokenCount": 600,
                "totalTokenCount": 1100,
            },
            "modelVersion": "gemini-3.1-pro-preview",
            "responseId": "r1",
        } | say.extra

    def problem(self, body: Mapping[str, Any]) -> str:
        asked: list[str] = []
        for content in body["contents"]:
            answered = [part["functionResponse"]["name"] for part in content["parts"] if "functionResponse" in part]
            if asked != answered:
                return f"function calls {asked} have the responses {answered}"
            asked = [part["functionCall"]["name"] for part in content["parts"] if "functionCall" in part]
        return ""

    def returns(self, body: Mapping[str, Any]) -> list[str]:
        tail = list(itertools.takewhile(lambda one: one["role"] != "model", reversed(body["contents"])))[::-1]
        answered = [
            part["functionResponse"] for content in tail for part in content["parts"] if "functionResponse" in part
        ]
        return [str(next(iter(one["response"].values()))) for one in answered]

    def last(self, body: Mapping[str, Any]) -> str:
        return [part["text"] for part in body["contents"][-1]["parts"] if "text" in part][-1]

    def error(self, status: int, message: str, code: str) -> dict[str, Any]:
        return {"error": {"code": status, "message": message, "status": code}}


@dataclass
class Service:
    """One provider in one test, with its queue of scripted replies and its received requests."""

    dialect: Dialect
    url: str
    steps: list[Step] = field(default_factory=list)
    seen: list[Seen] = field(default_factory=list)
    latency_s: float = 0.0
    crowd: int = 0
    """Number of concurrent requests for which the service waits before it answers any."""
    under_way: int = 0
    most_under_way: int = 0
    _crowded: anyio.Event = field(default_factory=anyio.Event)

    @property
    def environ(self) -> dict[str, str]:
        """Environment variables that direct clients to this service."""
        name = self.dialect.name.upper()
        return {f"{name}_API_KEY": KEY, f"{name}_BASE_URL": self.url}

    def say(self, text: str = "", calls: Calls = (), **more: Any) -> None:
        self.steps.append(Say(text, calls, **more))

    def compute(self, step: Callable[[Seen], Say]) -> None:
        """Queue a reply that is computed from the request."""
        self.steps.append(Computed(step))

    def fail(self, status: int, message: str = "no luck", code: str = "", details: Any = None, **headers: str) -> None:
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        body = self.dialect.error(status, message, code)
        body["error"] |= {"details": details} if details else {}
        self.steps.append(Bare(JSONResponse(body, status, named)))

    def raw(self, content: str) -> None:
        """Queue a response with status 200 and this body."""
        self.steps.append(Bare(Response(content, media_type="application/json")))

    def hang(self) -> None:
        """Queue a response that never comes, until the client times out."""

        async def silent(scope: Scope, receive: Receive, send: Send) -> None:
            while (await receive())["type"] != "http.disconnect":
                pass

        self.steps.append(Bare(silent))

    def drip(self) -> None:
        """Queue a response that is sent byte by byte until the client times out."""

        async def dripping(scope: Scope, receive: Receive, send: Send) -> None:
            await send(
                {"type": "http.response.start", "status": 200, "headers": [(b"content-type", b"application/json")]}
            )

            async def drop() -> None:
                while True:
                    await send({"type": "http.response.body", "body": b" ", "more_body": True})
                    await anyio.sleep(0.05)

            async with anyio.create_task_group() as tasks:
                tasks.start_soon(drop)
                while (await receive())["type"] != "http.disconnect":
                    pass
                tasks.cancel_scope.cancel()

        self.steps.append(Bare(dripping))

    def cut(self, text: str = "half a rep") -> None:
        """Queue a response that is half sent when the connection is closed."""

        async def half(scope: Scope, receive: Receive, send: Send) -> None:
            body = json.dumps(self.dialect.reply(Say(text))).encode()
            kind = b"application/json"
            if isinstance(self.dialect, Anthropic) and self.seen[-1].body.get("stream"):
                body, kind = self.dialect.stream(self.dialect.reply(Say(text))).encode(), b"text/event-stream"
            headers = [(b"content-type", kind), (b"content-length", str(len(body)).encode())]
            await send({"type": "http.response.start", "status": 200, "headers": headers})
            await send({"type": "http.response.body", "body": body[: len(body) // 2], "more_body": True})

        self.steps.append(Bare(half))

    async def serve(self, scope: Scope, receive: Receive, send: Send) -> None:
        request = Request(scope, receive)
        body = json.loads(await request.body())
        seen = Seen(request.url.path, dict(request.headers), body, self.dialect.returns(body), self.dialect.last(body))
        self.seen.append(seen)
        problem = self.dialect.problem(body)
        if problem or not self.steps:
            refused = self.dialect.error(400, problem or "nothing left to say", "invalid_request_error")
            await JSONResponse(refused, 400)(scope, receive, send)
            return
        self.under_way += 1
        self.most_under_way = max(self.most_under_way, self.under_way)
        try:
            await self._answer(self.steps.pop(0), seen, (scope, receive, send))
        finally:
            self.under_way -= 1

    async def _answer(self, step: Step, seen: Seen, connection: tuple[Scope, Receive, Send]) -> None:
        if isinstance(step, Bare):
            await step.serve(*connection)
            return
        if self.most_under_way >= self.crowd:
            self._crowded.set()
        await self._crowded.wait()
        await anyio.sleep(self.latency_s)
        reply = self.dialect.reply(step.make(seen) if isinstance(step, Computed) else step)
        if isinstance(self.dialect, Anthropic) and seen.body.get("stream"):
            await Response(self.dialect.stream(reply), media_type="text/event-stream")(*connection)
        else:
            await Response(json.dumps(reply), media_type="application/json")(*connection)


class Port:
    """The HTTP server, which maps paths to the services of tests."""

    def __init__(self) -> None:
        self.services: dict[str, Service] = {}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "http":
            await self.services[scope["path"].split("/")[1]].serve(scope, receive, send)
