"""Builds the client of a model choice, its tool definitions, and the settings of its requests.

This is the only module that knows how each provider's client is built and configured.
"""

import json
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, cast
from warnings import catch_warnings, simplefilter

import anyio
import httpx2
from pydantic_ai import AgentRunError, ModelRequest, ModelSettings, ToolDefinition
from pydantic_ai.direct import model_request
from pydantic_ai.models import Model, ModelRequestParameters

from evaluator.agents.models.choice import Dialect, ModelChoice
from evaluator.episode.player import ToolDescription
from evaluator.errors import UsageError

_NO_KEY = "no-key"
"""API key sent to providers that need none, because their clients require a value."""
_CONNECT_S = 15.0


def open_http(timeout_s: float, transport: httpx2.AsyncBaseTransport | None = None) -> httpx2.AsyncClient:
    """Create the HTTP client for one model; the caller closes it.

    Args:
        timeout_s: Longest time without data from the server [s].
        transport: HTTP transport to use in place of the network, for tests.
    """
    return httpx2.AsyncClient(
        timeout=httpx2.Timeout(timeout_s, connect=_CONNECT_S),
        # `Lane` limits concurrency, so the pool must not.
        limits=httpx2.Limits(max_connections=None, max_keepalive_connections=100),
        transport=transport,
        follow_redirects=True,
    )


def build_model(choice: ModelChoice, http: httpx2.AsyncClient) -> Model:
    """Build the client of a model. It uses the given HTTP client and does not retry."""
    build = {
        Dialect.OPENAI: _chat_completions,
        Dialect.OPENROUTER: _openrouter,
        Dialect.ANTHROPIC: _anthropic,
        Dialect.GOOGLE: _google,
    }[choice.provider.dialect]
    return build(choice, choice.key() or _NO_KEY, http)


# Each function imports only its own package: all of them together take a second, and some may not be installed.


def _chat_completions(choice: ModelChoice, key: str, http: httpx2.AsyncClient) -> Model:
    from pydantic_ai.models.openai import OpenAIChatModel  # noqa: PLC0415 - see above
    from pydantic_ai.profiles.openai import OpenAIModelProfile  # noqa: PLC0415 - see above
    from pydantic_ai.providers.openai import OpenAIProvider  # noqa: PLC0415 - see above
    from pydantic_ai.providers.openai_compatible import OpenAICompatibleProvider  # noqa: PLC0415 - see above

    name, url = choice.model, choice.base_url
    if choice.provider.name == "openai":
        return OpenAIChatModel(name, provider=OpenAIProvider(api_key=key, base_url=url, http_client=http))
    # Only OpenAI itself requires `max_completion_tokens`; all others accept `max_tokens`.
    profile = OpenAIModelProfile(openai_chat_supports_max_completion_tokens=False)
    provider = OpenAICompatibleProvider(
        choice.provider.name, base_url=url, api_key=key, http_client=http, profile=profile
    )
    return OpenAIChatModel(name, provider=provider)


def _openrouter(choice: ModelChoice, key: str, http: httpx2.AsyncClient) -> Model:
    from openai import AsyncOpenAI  # noqa: PLC0415 - see above
    from pydantic_ai.models.openrouter import OpenRouterModel  # noqa: PLC0415 - see above
    from pydantic_ai.providers.openrouter import OpenRouterProvider  # noqa: PLC0415 - see above

    # The provider class only uses its own address; the client underneath accepts any.
    client = AsyncOpenAI(api_key=key, base_url=choice.base_url, http_client=http)
    return OpenRouterModel(choice.model, provider=OpenRouterProvider(openai_client=client))


def _anthropic(choice: ModelChoice, key: str, http: httpx2.AsyncClient) -> Model:
    from pydantic_ai.models.anthropic import AnthropicModel  # noqa: PLC0415 - see above
    from pydantic_ai.providers.anthropic import AnthropicProvider  # noqa: PLC0415 - see above

    provider = AnthropicProvider(api_key=key, base_url=choice.base_url, http_client=http)
    return AnthropicModel(choice.model, provider=provider)


def _google(choice: ModelChoice, key: str, http: httpx2.AsyncClient) -> Model:
    from pydantic_ai.models.google import GoogleModel  # noqa: PLC0415 - see above
    from pydantic_ai.providers.google import GoogleProvider  # noqa: PLC0415 - see above

    provider = GoogleProvider(api_key=key, base_url=choice.base_url, http_client=http)
    return GoogleModel(choice.model, provider=provider)


def request_settings(model: Model, choice: ModelChoice, timeout_s: float) -> ModelSettings:
    """Return the settings of each request.

    Args:
        model: The client that sends the request, which knows what the model supports.
        choice: The model and its options. Its wire format determines how the options are written.
        timeout_s: Longest duration of a request, to the last byte of its reply [s].
    """
    options, dialect = choice.options, choice.provider.dialect
    settings: dict[str, Any] = {"timeout": timeout_s, "request_timeout": timeout_s, "max_retries": 0}
    if options.temperature is not None:
        settings["temperature"] = options.temperature
    if options.max_tokens is not None:
        settings["max_tokens"] = options.max_tokens
    if options.effort is not None:
        settings |= _effort(dialect, options.effort)
    if dialect is Dialect.ANTHROPIC:
        # Other providers cache a growing conversation automatically. Caching changes the price but not the replies.
        settings["cache"] = True
    return cast(ModelSettings, settings | _thoughts_shown(model, dialect, options.effort))


def _effort(dialect: Dialect, effort: str) -> dict[str, Any]:
    match dialect:
        case Dialect.OPENAI:
            # Not the unified setting, which the client drops for models that it does not list as reasoning models.
            return {"openai_reasoning_effort": effort}
        case Dialect.OPENROUTER:
            return {"openrouter_reasoning": {"effort": effort}}
        case Dialect.ANTHROPIC | Dialect.GOOGLE:
            return {"thinking": False if effort == "none" else effort}


def _thoughts_shown(model: Model, dialect: Dialect, effort: str | None) -> dict[str, Any]:
    """Return the settings that make a model's reasoning visible, because reasoning is part of the record."""
    profile = cast(dict[str, Any], model.profile)
    if dialect is Dialect.GOOGLE and effort is None:
        return {"thinking": True}
    thinks = effort or profile.get("thinking_enabled_by_default") or profile.get("thinking_always_enabled")
    adaptive = dialect is Dialect.ANTHROPIC and profile.get("anthropic_supports_adaptive_thinking")
    if adaptive and thinks and effort != "none":
        return {"anthropic_thinking": {"type": "adaptive", "display": "summarized"}}
    return {}


_CONTENT = frozenset({"model", "messages", "system", "contents", "systemInstruction", "tools", "stream"})
"""Request fields that are not settings."""
_TIMEOUT_S = 60.0


def settings_sent(choice: ModelChoice) -> dict[str, Any]:
    """Return the settings in the body of a request to the model.

    Raises:
        UsageError: An option does not change the request, because the client omits options that the model does not
            accept. The record would then claim an option without effect.
    """
    with ThreadPoolExecutor(1) as thread:
        # A separate thread, so that this works with and without a running event loop.
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
    """A transport that stores the body of a request and rejects the request."""

    def __init__(self) -> None:
        self.body: bytes | None = None

    async def handle_async_request(self, request: httpx2.Request) -> httpx2.Response:
        self.body = await request.aread()
        return httpx2.Response(400, json={"error": {"message": "nothing is sent"}}, request=request)


@dataclass(frozen=True, slots=True)
class Offer:
    """The tool definitions of a conversation's requests."""

    parameters: ModelRequestParameters
    settings: ModelSettings
    """Added to the settings of every request."""


NOTHING = Offer(ModelRequestParameters(), ModelSettings())
"""No tools, for models that write their calls as text."""


def offer(dialect: Dialect, tools: Sequence[ToolDescription]) -> Offer:
    """Build the tool definitions from the schemas that the server published.

    For chat completions they are written directly into the request body, because the client would convert all 26
    schemas again for each request: 2 to 3 ms, nearly half of the processor time of a turn. For the other providers the
    client converts them to the subset of JSON Schema that the provider accepts.
    """
    if dialect in {Dialect.OPENAI, Dialect.OPENROUTER}:
        functions = [
            {"name": tool.name, "description": tool.description, "parameters": dict(tool.input_schema)}
            for tool in tools
        ]
        body = {"tools": [{"type": "function", "function": function} for function in functions]}
        return Offer(ModelRequestParameters(), ModelSettings(extra_body=body))
    definitions = [
        # With `strict`, a provider may change the schemas; the loop validates calls against the published ones.
        ToolDefinition(
            name=tool.name, parameters_json_schema=dict(tool.input_schema), description=tool.description, strict=False
        )
        for tool in tools
    ]
    return Offer(ModelRequestParameters(function_tools=definitions), ModelSettings())
