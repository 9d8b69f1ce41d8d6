"""Data: the providers that can be asked, and the seven models of the paper by name.

Imports no provider's client, so that the command line can read it quickly.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from urllib.parse import urlsplit, urlunsplit


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
    """Environment variables that may hold the key. The first that is set counts."""
    needs_key: bool = True
    base_url_variable: str = ""
    """Environment variable that overrides `base_url`; by default NAME_BASE_URL."""

    @property
    def url_variable(self) -> str:
        """Environment variable that overrides the base URL."""
        return self.base_url_variable or f"{self.name.upper()}_BASE_URL"

    def key(self, environ: Mapping[str, str]) -> str | None:
        """The key that the environment holds, if any."""
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
"""The seven models of the paper. The four with open weights are asked at OpenRouter, with one key for all of them.
A model at another provider is `model:PROVIDER:NAME`."""


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
