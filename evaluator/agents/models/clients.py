"""From a model choice to the client that asks it. Only this module knows how to build and set each client."""

from typing import Any, cast

import httpx2
from pydantic_ai.models import Model
from pydantic_ai.settings import ModelSettings

from evaluator.agents.models.choice import ModelChoice
from evaluator.agents.models.presets import Dialect

_NO_KEY = "no-key"
"""Sent to providers that need no key, since clients require one."""
_CONNECT_S = 15.0


def open_http(timeout_s: float, transport: httpx2.AsyncBaseTransport | None = None) -> httpx2.AsyncClient:
    """An HTTP client for one model, to be closed by the caller.

    Args:
        timeout_s: Longest silence of a server [s].
        transport: Receives the requests instead of the network.
    """
    return httpx2.AsyncClient(
        timeout=httpx2.Timeout(timeout_s, connect=_CONNECT_S),
        # The pool must not limit concurrency: the lane does that.
        limits=httpx2.Limits(max_connections=None, max_keepalive_connections=100),
        transport=transport,
        follow_redirects=True,
    )


def build_model(choice: ModelChoice, http: httpx2.AsyncClient) -> Model:
    """The client of a model, which uses our HTTP client and does not retry."""
    build = {
        Dialect.OPENAI: _chat_completions,
        Dialect.OPENROUTER: _openrouter,
        Dialect.ANTHROPIC: _anthropic,
        Dialect.GOOGLE: _google,
    }[choice.provider.dialect]
    return build(choice, choice.key() or _NO_KEY, http)


# Each function loads only its own package: together they take a second, and not all may be installed.


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

    # The provider class knows only its own address; the client underneath accepts any.
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
    """The settings of each request.

    Args:
        model: The client that sends them, which knows what the model supports.
        choice: The model and its options; its wire format decides how options are written.
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
        # Other providers cache a growing conversation by themselves. This changes the price, not the replies.
        settings["cache"] = True
    return cast(ModelSettings, settings | _thoughts_shown(model, dialect, options.effort))


def _effort(dialect: Dialect, effort: str) -> dict[str, Any]:
    match dialect:
        case Dialect.OPENAI:
            # Not the unified setting, which the client drops for models that it does not list as thinking.
            return {"openai_reasoning_effort": effort}
        case Dialect.OPENROUTER:
            return {"openrouter_reasoning": {"effort": effort}}
        case Dialect.ANTHROPIC | Dialect.GOOGLE:
            return {"thinking": False if effort == "none" else effort}


def _thoughts_shown(model: Model, dialect: Dialect, effort: str | None) -> dict[str, Any]:
    """The settings that make the thoughts of a thinking model visible, since reasoning is part of the record."""
    profile = cast(dict[str, Any], model.profile)
    if dialect is Dialect.GOOGLE and effort is None:
        return {"thinking": True}
    thinks = effort or profile.get("thinking_enabled_by_default") or profile.get("thinking_always_enabled")
    adaptive = dialect is Dialect.ANTHROPIC and profile.get("anthropic_supports_adaptive_thinking")
    if adaptive and thinks and effort != "none":
        return {"anthropic_thinking": {"type": "adaptive", "display": "summarized"}}
    return {}
