"""Parses `model:…` into a model, its address and options; lists models; limits requests. Imports no client library."""

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from importlib.util import find_spec
from urllib.parse import urlsplit, urlunsplit

import anyio
import httpx2

from evaluator.errors import UsageError


class Dialect(StrEnum):
    """The wire format that a provider speaks."""

    OPENAI = "openai-chat"
    """OpenAI chat completions, which most servers offer."""
    OPENROUTER = "openrouter"
    """OpenAI chat completions, with OpenRouter's fields for reasoning."""
    ANTHROPIC = "anthropic-messages"
    GOOGLE = "gemini-generate-content"


@dataclass(frozen=True, slots=True)
class Provider:
    """A service or a local server that runs models."""

    name: str
    title: str
    dialect: Dialect
    base_url: str
    """Its address; empty if only the operator knows it."""
    key_variables: tuple[str, ...]
    """Environment variables that may hold the API key, in order of precedence."""
    needs_key: bool = True
    base_url_variable: str = ""
    """Environment variable that overrides `base_url`; by default NAME_BASE_URL."""

    @property
    def url_variable(self) -> str:
        """Environment variable that overrides the base URL."""
        return self.base_url_variable or f"{self.name.upper()}_BASE_URL"

    def key(self, environ: Mapping[str, str]) -> str | None:
        """Return the API key from the environment, if it is set."""
        return next((environ[name] for name in self.key_variables if environ.get(name)), None)

    def url(self, environ: Mapping[str, str]) -> str:
        """The base URL, from the environment or else the provider's own; empty if neither is known."""
        return environ.get(self.url_variable) or self.base_url

    def shown_url(self, environ: Mapping[str, str]) -> str:
        """The base URL without secrets."""
        return public_url(self.url(environ))


@dataclass(frozen=True, slots=True)
class Preset:
    """A short name for a model."""

    name: str
    title: str
    provider: str
    model: str
    """The model's id at the provider."""


PROVIDERS = (
    Provider("openai", "OpenAI", Dialect.OPENAI, "https://api.openai.com/v1", ("OPENAI_API_KEY",)),
    Provider("anthropic", "Anthropic", Dialect.ANTHROPIC, "https://api.anthropic.com", ("ANTHROPIC_API_KEY",)),
    Provider(
        "google",
        "Google Gemini API",
        Dialect.GOOGLE,
        "https://generativelanguage.googleapis.com",
        ("GOOGLE_API_KEY", "GEMINI_API_KEY"),
    ),
    Provider("openrouter", "OpenRouter", Dialect.OPENROUTER, "https://openrouter.ai/api/v1", ("OPENROUTER_API_KEY",)),
    Provider("together", "Together AI", Dialect.OPENAI, "https://api.together.xyz/v1", ("TOGETHER_API_KEY",)),
    Provider("groq", "Groq", Dialect.OPENAI, "https://api.groq.com/openai/v1", ("GROQ_API_KEY",)),
    Provider("vllm", "vLLM, local", Dialect.OPENAI, "http://localhost:8000/v1", ("VLLM_API_KEY",), needs_key=False),
    Provider(
        "ollama", "Ollama, local", Dialect.OPENAI, "http://localhost:11434/v1", ("OLLAMA_API_KEY",), needs_key=False
    ),
    Provider(
        "lmstudio",
        "LM Studio, local",
        Dialect.OPENAI,
        "http://localhost:1234/v1",
        ("LMSTUDIO_API_KEY",),
        needs_key=False,
    ),
    Provider(
        "openai-compatible",
        "any other server that speaks OpenAI chat completions",
        Dialect.OPENAI,
        "",
        ("PHYSMENT_API_KEY",),
        needs_key=False,
        base_url_variable="PHYSMENT_BASE_URL",
    ),
)

PRESETS = (
    Preset("gpt-5.5", "GPT-5.5", "openai", "gpt-5.5"),
    Preset("gemini-3.1-pro", "Gemini 3.1 Pro", "google", "gemini-3.1-pro-preview"),
    Preset("claude-opus-4.7", "Claude Opus 4.7", "anthropic", "claude-opus-4-7"),
    Preset("deepseek-r1", "DeepSeek R1", "openrouter", "deepseek/deepseek-r1"),
    Preset("glm-5", "GLM-5", "openrouter", "z-ai/glm-5"),
    Preset("kimi-k2.5", "Kimi K2.5", "openrouter", "moonshotai/kimi-k2.5"),
    Preset("qwen-3.5", "Qwen 3.5", "openrouter", "qwen/qwen3.5-397b-a17b"),
)
"""The seven models of the paper. The four open-weight models are requested from OpenRouter, with one key for all of
them. A model at another provider is `model:PROVIDER:NAME`."""


def public_url(url: str) -> str:
    """A URL without user, password, query and fragment, for records and messages; empty if it is not a URL."""
    try:
        parts = urlsplit(url)
    except ValueError:
        return ""
    return urlunsplit((parts.scheme, parts.netloc.rpartition("@")[2], parts.path, "", ""))


def find_provider(name: str) -> Provider | None:
    """The provider of that name, if there is one."""
    return next((provider for provider in PROVIDERS if provider.name == name), None)


def find_preset(name: str) -> Preset | None:
    """The preset of that name, if there is one."""
    return next((preset for preset in PRESETS if preset.name == name), None)


EFFORTS = ("none", "minimal", "low", "medium", "high", "xhigh", "max")
"""Levels of reasoning effort. A provider supports some of these."""
EXTRA = "physment-mcp[models]"
"""The optional dependency that language models require."""
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
    """Largest number of tokens in one reply, including reasoning."""


@dataclass(frozen=True, slots=True)
class ModelChoice:
    """A model, its address and its options. The API key stays in the environment."""

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
        """Return what prevents requests to the model, as clauses; empty if nothing does."""
        return missing(self.provider, self.environ, self.base_url)


def parse_model(
    text: str, options: Options = Options(), base_url: str | None = None, environ: Mapping[str, str] | None = None
) -> ModelChoice:
    """Parse `model:PRESET` or `model:PROVIDER:NAME`, optionally with `,effort=…,temperature=…,max_tokens=…`.

    Args:
        text: The value of `--agent`.
        options: Default options; options in `text` take precedence.
        base_url: Base URL that replaces the provider's own.
        environ: Environment variables; by default those of the process.

    Raises:
        UsageError: The model is unknown, or an option is malformed.
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
    """Validate options and return them.

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
    """Return what prevents requests to a provider, as clauses; empty if nothing does."""
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
    """Resolve a preset or PROVIDER:NAME to a provider and a model id."""
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


DEFAULT_LIMIT = 8
"""Default limit on concurrent requests to one provider."""


@dataclass(frozen=True, slots=True)
class Patience:
    """Retry and time-out settings for one turn of a model."""

    timeout_s: float = 600.0
    """Longest duration of one request, to the last byte of its reply [s]."""
    attempts: int = 6
    """Largest number of requests before the turn fails."""
    first_pause_s: float = 1.0
    """Pause before the second attempt [s]; doubled for each further attempt."""
    longest_pause_s: float = 60.0
    """Upper limit of the doubled pause [s]; a provider may request a longer one."""
    total_wait_s: float = 900.0
    """Largest total of all pauses in a turn [s]."""


@dataclass(slots=True)
class Lane:
    """Rate limits shared by all requests to one provider."""

    limit: int = DEFAULT_LIMIT
    shut_until: float = -math.inf
    """No request starts before this time on the clock of `Requests` [s]."""
    _limiter: anyio.CapacityLimiter | None = field(default=None, repr=False)

    @property
    def limiter(self) -> anyio.CapacityLimiter:
        """Semaphore for concurrent requests. Created at first use, because it belongs to an event loop."""
        if self._limiter is None:
            self._limiter = anyio.CapacityLimiter(self.limit)
        return self._limiter


@dataclass(slots=True)
class Lanes:
    """The lanes of a run, one per provider. All agents of a provider share its lane."""

    limits: Mapping[str, int] = field(default_factory=dict[str, int])
    """Provider → limit on concurrent requests."""
    default: int = DEFAULT_LIMIT
    _lanes: dict[str, Lane] = field(default_factory=dict[str, Lane], repr=False)

    def of(self, provider: str) -> Lane:
        """Return the lane of a provider, and create it if necessary."""
        return self._lanes.setdefault(provider, Lane(self.limits.get(provider, self.default)))
