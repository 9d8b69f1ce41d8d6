"""`physment-eval models`: which language models can be asked, and what is missing to ask them."""

import argparse
import json
import os
from collections.abc import Mapping

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from evaluator.commands.base import Commands, wide_console
from evaluator.models.choice import EFFORTS, missing
from evaluator.models.presets import PRESETS, PROVIDERS, Provider, find_provider

_DESCRIPTION = f"""\
List the models and providers that `--agent model:…` knows, and say what is missing to ask them.

  --agent model:gpt-5.5                            a preset: one of the paper's seven models
  --agent model:ollama:qwen3:8b                    any model of a provider
  --agent model:openai-compatible:NAME             any server that speaks OpenAI chat completions (PHYSMENT_BASE_URL)
  --agent model:gpt-5.5,effort=high,max_tokens=32000
                                                   options: effort ({" · ".join(EFFORTS)}), temperature, max_tokens

The base URL of each provider can be set by an environment variable, which the list names.
"""


def add(commands: Commands) -> None:
    """Declare `models`."""
    models = commands.add_parser(
        "models",
        help="list language models, and what is missing to ask them",
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
    """Presets and providers as data; names of variables, never what is in them."""
    return {
        "presets": [
            {
                "agent": f"model:{one.name}",
                "title": one.title,
                "provider": one.provider,
                "model": one.model,
                "missing": missing(_of(one.provider), environ),
            }
            for one in PRESETS
        ],
        "providers": [
            {
                "agent": f"model:{one.name}:NAME",
                "title": one.title,
                "format": one.dialect.value,
                "base_url": one.shown_url(environ),
                "base_url_variable": one.url_variable,
                "key_variables": list(one.key_variables),
                "needs_key": one.needs_key,
                "missing": missing(one, environ),
            }
            for one in PROVIDERS
        ],
    }


def _print(console: Console, environ: Mapping[str, str]) -> None:
    presets = _table("agent", "model", "asked at", "as", "missing")
    for one in PRESETS:
        presets.add_row(f"model:{one.name}", one.title, one.provider, one.model, _state(_of(one.provider), environ))
    providers = _table("agent", "base URL", "set by", "key", "missing")
    for one in PROVIDERS:
        key = " or ".join(one.key_variables) if one.needs_key else "none needed"
        where = one.shown_url(environ)
        providers.add_row(f"model:{one.name}:NAME", escape(where), one.url_variable, key, _state(one, environ))
    console.print(presets)
    console.print()
    console.print(providers)
    console.print("\nWhat the options are, and how to name other models: physment-eval models --help", highlight=False)


def _table(*titles: str) -> Table:
    table = Table(box=None, pad_edge=False)
    for title in titles:
        table.add_column(title, overflow="fold")
    return table


def _state(provider: Provider, environ: Mapping[str, str]) -> str:
    """What is missing, or that nothing is."""
    return escape("; ".join(missing(provider, environ))) or "[green]nothing[/]"


def _of(name: str) -> Provider:
    provider = find_provider(name)
    assert provider is not None, "every preset names a provider of the list"
    return provider
