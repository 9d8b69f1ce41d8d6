"""What `model:…` means: which model, at which address, with which options. Loads no provider's client."""

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib.util import find_spec

import httpx2

from evaluator.agents.models.presets import (
    PRESETS,
    PROVIDERS,
    Dialect,
    Provider,
    find_preset,
    find_provider,
    public_url,
)
from evaluator.errors import UsageError

EFFORTS = ("none", "minimal", "low", "medium", "high", "xhigh", "max")
"""How hard a model is asked to think. A provider supports some of these."""
EXTRA = "physment-mcp[models]"
"""The package to install for asking models."""
_CLIENTS = {
    Dialect.OPENAI: "openai",
    Dialect.OPENROUTER: "openai",
    Dialect.ANTHROPIC: "anthropic",
    Dialect.GOOGLE: "google.genai",
}
"""Dialect → the package that implements it."""


@dataclass(frozen=True, slots=True)
class Options:
    """Options of a model; None leaves an option to the provider."""

    effort: str | None = None
    """One of `EFFORTS`."""
    temperature: float | None = None
    max_tokens: int | None = None
    """Most tokens of one reply, including thoughts."""


@dataclass(frozen=True, slots=True)
class ModelChoice:
    """A model, its address and its options. Does not hold the key, which stays in the environment."""

    name: str
    """The agent's name in records, as the operator wrote it."""
    provider: Provider
    model: str
    base_url: str
    options: Options = Options()
    environ: Mapping[str, str] = field(default_factory=lambda: os.environ, repr=False, compare=False)

    @property
    def shown_url(self) -> str:
        """The base URL without user, password and query, for records and messages."""
        return public_url(self.base_url)

    def key(self) -> str | None:
        """The provider's key, if the environment holds one."""
        return self.provider.key(self.environ)

    def missing(self) -> list[str]:
        """What is missing to ask the model, as clauses; empty if nothing is."""
        return missing(self.provider, self.environ, self.base_url)


def parse_model(
    text: str, options: Options = Options(), base_url: str | None = None, environ: Mapping[str, str] | None = None
) -> ModelChoice:
    """Read `model:PRESET` or `model:PROVIDER:NAME`, which `,effort=…,temperature=…,max_tokens=…` may follow.

    Args:
        text: What the operator wrote.
        options: Options of all models; options in `text` win.
        base_url: Address to ask, instead of the provider's own.
        environ: Environment variables; by default those of the process.

    Raises:
        UsageError: There is no such model, or an option is malformed.
    """
    environ = os.environ if environ is None else environ
    named, *pairs = text.split(",")
    provider, model = _resolve(text, named.removeprefix("model:"))
    for pair in pairs:
        options = _with_option(text, options, pair)
    where = base_url or provider.url(environ)
    try:
        url = httpx2.URL(where)
    except httpx2.InvalidURL as error:
        raise UsageError(f"{text}: the base URL is not a URL: {error}") from error
    if where and (url.scheme not in {"http", "https"} or not url.host or (url.port or 0) > 65535):
        raise UsageError(f"{text}: the base URL must look like https://host/v1")
    return ModelChoice(text, provider, model, where, checked(options), environ)


def checked(options: Options) -> Options:
    """The options, checked.

    Raises:
        UsageError: An option is out of range.
    """
    if options.effort is not None and options.effort not in EFFORTS:
        raise UsageError(f"effort {options.effort}: must be one of {', '.join(EFFORTS)}")
    if options.temperature is not None and not 0 <= options.temperature <= 2:
        raise UsageError(f"temperature {options.temperature:g}: must be from 0 to 2")
    if options.max_tokens is not None and options.max_tokens < 1:
        raise UsageError(f"max_tokens {options.max_tokens}: must be 1 or more")
    return options


def missing(provider: Provider, environ: Mapping[str, str], base_url: str | None = None) -> list[str]:
    """What is missing to ask a provider, as clauses; empty if nothing is."""
    found: list[str] = []
    if not client_installed(provider.dialect):
        found.append(f"its client is not installed (pip install '{EXTRA}')")
    if provider.needs_key and provider.key(environ) is None:
        found.append(f"{' or '.join(provider.key_variables)} is not set")
    if not (base_url or provider.url(environ)):
        found.append(f"no base URL (--base-url or {provider.url_variable})")
    return found


def client_installed(dialect: Dialect) -> bool:
    """Whether the package for a dialect is installed. Loads only its parent package."""
    try:
        return find_spec("pydantic_ai") is not None and find_spec(_CLIENTS[dialect]) is not None
    except ModuleNotFoundError:
        return False


def _resolve(text: str, name: str) -> tuple[Provider, str]:
    """Provider and model id that a preset or PROVIDER:NAME stands for."""
    preset = find_preset(name)
    if preset is not None:
        name = f"{preset.provider}:{preset.model}"
    head, colon, model = name.partition(":")
    provider = find_provider(head)
    if not colon:
        known = ", ".join(preset.name for preset in PRESETS)
        raise UsageError(f"{text}: there is no such preset; the presets are {known}; or write model:PROVIDER:NAME")
    if provider is None:
        known = ", ".join(provider.name for provider in PROVIDERS)
        raise UsageError(f"{text}: there is no provider {head!r}; the providers are {known}")
    if not model:
        raise UsageError(f"{text}: the name of the model is missing: model:{head}:NAME")
    if provider.dialect is Dialect.OPENROUTER and "/" not in model:
        raise UsageError(f"{text}: OpenRouter's models are named VENDOR/MODEL")
    return provider, model


def _with_option(text: str, options: Options, pair: str) -> Options:
    name, _, value = pair.partition("=")
    try:
        match name:
            case "effort":
                return replace(options, effort=value)
            case "temperature":
                return replace(options, temperature=float(value))
            case "max_tokens":
                return replace(options, max_tokens=int(value))
            case _:
                raise UsageError(f"{text}: there is no option {name!r}; they are effort, temperature, max_tokens")
    except ValueError as error:
        raise UsageError(f"{text}: {name} must be a number, not {value!r}") from error
