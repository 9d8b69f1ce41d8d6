"""The options of models, which several commands have: how they are declared, and what they ask for."""

import argparse
from typing import TYPE_CHECKING, TypedDict

from evaluator.agents.models.choice import EFFORTS, Options, checked
from evaluator.agents.models.lanes import DEFAULT_LIMIT, Patience
from evaluator.commands.argument_types import count_of, seconds, temperature
from evaluator.errors import UsageError

if TYPE_CHECKING:
    from argparse import _ArgumentGroup as ArgumentGroup  # pyright: ignore[reportPrivateUsage] - has no public name


class ModelOptions(TypedDict):
    """Fields of `RunConfig` that the options of models decide."""

    model_options: Options
    base_url: str | None
    lanes: dict[str, int]
    patience: Patience


def add_model_options(group: "ArgumentGroup") -> None:
    """Declare the options of all models of a run."""
    group.description = (
        "For all models of the run. `physment-eval models` lists models and what is missing to ask them."
    )
    group.add_argument("--effort", metavar="E", help=f"{' · '.join(EFFORTS)}, as far as the provider has them")
    group.add_argument("--temperature", type=temperature, metavar="T", help="0 to 2 (default: the provider's)")
    group.add_argument(
        "--reply-tokens", type=count_of("tokens"), metavar="N", help="most tokens of one reply, thoughts included"
    )
    group.add_argument(
        "--base-url", metavar="URL", help="where models are asked, instead of the provider's own address"
    )
    group.add_argument(
        "--provider-concurrency",
        metavar="P=N,…",
        default="",
        help=f"requests to a provider at a time, such as openai=20,anthropic=5 (default {DEFAULT_LIMIT} each)",
    )
    group.add_argument(
        "--request-timeout", type=seconds, default=Patience().timeout_s, metavar="S", help="of one request [s] (600)"
    )


def model_options(args: argparse.Namespace) -> ModelOptions:
    """The part of a `RunConfig` that the options of models decide.

    Raises:
        UsageError: An option is malformed.
    """
    return {
        "model_options": checked(Options(args.effort, args.temperature, args.reply_tokens)),
        "base_url": args.base_url,
        "lanes": _lanes(args.provider_concurrency),
        "patience": Patience(timeout_s=args.request_timeout),
    }


def _lanes(text: str) -> dict[str, int]:
    lanes: dict[str, int] = {}
    for part in filter(None, text.split(",")):
        name, equals, limit = part.partition("=")
        if not equals or not limit.isdecimal() or int(limit) < 1:
            raise UsageError(f"--provider-concurrency {part}: write provider=number, such as openai=20")
        lanes[name.strip()] = int(limit)
    return lanes
