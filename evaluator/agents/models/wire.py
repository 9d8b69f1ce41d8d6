"""Which settings a request would really contain: the client writes a request, which is not sent."""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import Any
from warnings import catch_warnings, simplefilter

import anyio
import httpx2
from pydantic_ai.direct import model_request
from pydantic_ai.exceptions import AgentRunError
from pydantic_ai.messages import ModelRequest

from evaluator.agents.models.choice import ModelChoice
from evaluator.agents.models.clients import build_model, open_http, request_settings
from evaluator.errors import UsageError

_CONTENT = frozenset({"model", "messages", "system", "contents", "systemInstruction", "tools", "stream"})
"""Fields of a request that are not settings."""
_TIMEOUT_S = 60.0


def settings_sent(choice: ModelChoice) -> dict[str, Any]:
    """The settings in the body of a request to the model.

    Raises:
        UsageError: An option does not change the request, so it would be recorded without effect. Clients leave out
            options that a model does not accept.
    """
    with ThreadPoolExecutor(1) as thread:
        # In a thread, so that this works with and without a running event loop.
        sent = thread.submit(_body, choice).result()
        for name in ("effort", "temperature", "max_tokens"):
            value = getattr(choice.options, name)
            if value is None or value == "none":
                continue
            without = replace(choice, options=replace(choice.options, **{name: None}))
            if thread.submit(_body, without).result() == sent:
                raise UsageError(
                    f"{choice.name}: {name} {value} would not be sent, since this model does not take it, or not"
                    f" with the other options; give it only to models that do, as model:NAME,{name}={value}"
                )
    return sent


def _body(choice: ModelChoice) -> dict[str, Any]:
    with catch_warnings():
        # The client warns about options that it leaves out; the caller raises an error instead.
        simplefilter("ignore")
        return anyio.run(_written, choice)


async def _written(choice: ModelChoice) -> dict[str, Any]:
    catch = _Catch()
    async with open_http(_TIMEOUT_S, catch) as http:
        model = build_model(choice, http)
        settings = request_settings(model, choice, _TIMEOUT_S)
        try:
            await model_request(model, [ModelRequest.user_text_prompt("x")], model_settings=settings)
        except AgentRunError:
            assert catch.body is not None
    body: dict[str, Any] = json.loads(catch.body or b"{}")
    return {name: value for name, value in body.items() if name not in _CONTENT}


class _Catch(httpx2.AsyncBaseTransport):
    """Keeps the body of a request, and refuses the request."""

    def __init__(self) -> None:
        self.body: bytes | None = None

    async def handle_async_request(self, request: httpx2.Request) -> httpx2.Response:
        self.body = await request.aread()
        return httpx2.Response(400, json={"error": {"message": "nothing is sent"}}, request=request)
