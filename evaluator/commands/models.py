"""`physment-eval models`: lists language models and, for each, a missing API key or client library."""

import argparse
import json
import os
from collections.abc import Mapping

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from evaluator.agents.models.choice import EFFORTS, PRESETS, PROVIDERS, Provider, find_provider, missing
from evaluator.commands.base import Commands, wide_console

_DESCRIPTION = f"""\
List the models and providers that `--agent model:…` accepts, and what is missing to ask them.

  --agent model:gpt-5.5                            a preset: one of the paper's seven models
  --agent model:ollama:qwen3:8b                    any model of a provider
  --agent model:openai-compatible:NAME             any server that speaks OpenAI chat completions (PHYSMENT_BASE_URL)
  --agent model:gpt-5.5,effort=high,max_tokens=32000
                                                   options: effort ({" · ".join(EFFORTS)}), temperature, max_tokens

The list names the environment variable that sets the base URL of each provider.
"""


def add(commands: Commands) -> None:
    """Declare the command `models` and its options."""
    models = commands.add_parser(
        "models",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    models.set_defaults(run=_models)
    models.add_argument("--json", action="store_true", help="print the list as JSON")


def _models(args: argparse.Namespace) -> int:
    if args.json:
        print(json.dumps(_listing(os.environ), indent=2))
    else:
        _print(wide_console(), os.environ)
    return 0


def _listing(environ: Mapping[str, str]) -> dict[str, list[dict[str, object]]]:
    """Return presets and providers for JSON output, with names of environment variables but never their values."""
    return {
        "presets": [
            {
                "agent": f"model:{preset.name}",
                "title": preset.title,
                "provider": preset.provider,
                "model": preset.model,
                "missing": missing(_of(preset.provider), environ),
            }
            for preset in PRESETS
        ],
        "providers": [
            {
                "agent": f"model:{provider.name}:NAME",
                "title": provider.title,
                "format": provider.dialect.value,
                "base_url": provider.shown_url(environ),
                "base_url_variable": provider.url_variable,
                "key_variables": list(provider.key_variables),
                "needs_key": provider.needs_key,
                "missing": missing(provider, environ),
            }
            for provider in PROVIDERS
        ],
    }


def _print(console: Console, environ: Mapping[str, str]) -> None:
    presets = _table("agent", "model", "provider", "model id", "missing")
    for preset in PRESETS:
        state = _state(_of(preset.provider), environ)
        presets.add_row(f"model:{preset.name}", preset.title, preset.provider, preset.model, state)
    providers = _table("agent", "base URL", "set by", "key", "missing")
    for provider in PROVIDERS:
        key = " or ".join(provider.key_variables) if provider.needs_key else "none needed"
        url, state = escape(provider.shown_url(environ)), _state(provider, environ)
        providers.add_row(f"model:{provider.name}:NAME", url, provider.url_variable, key, state)
    console.print(presets)
    console.print()
    console.print(providers)
    console.print("\nOptions, and how to name other models: physment-eval models --help", highlight=False)


def _table(*titles: str) -> Table:
    table = Table(box=None, pad_edge=False)
    for title in titles:
        table.add_column(title, overflow="fold")
    return table


def _state(provider: Provider, environ: Mapping[str, str]) -> str:
    """Return what is missing to use a provider, or "nothing"."""
    return escape("; ".join(missing(provider, environ))) or "[green]nothing[/]"


def _of(name: str) -> Provider:
    provider = find_provider(name)
    assert provider is not None, "every preset names a known provider"
    return provider
