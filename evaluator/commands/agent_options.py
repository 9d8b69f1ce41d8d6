"""Command line options of models and of external agents, and their conversion to fields of `RunConfig`."""

import argparse
import os
from pathlib import Path
from typing import TypedDict

from evaluator.agents.external.agent import CALLS_PER_ITERATION
from evaluator.agents.external.isolation import TOKEN, URL
from evaluator.agents.models.choice import DEFAULT_LIMIT, EFFORTS, Options, Patience, checked
from evaluator.commands.base import OptionGroup, count_of, seconds, temperature
from evaluator.errors import UsageError


class ModelOptions(TypedDict):
    """Fields of `RunConfig` that are set by the options of models."""

    model_options: Options
    base_url: str | None
    lanes: dict[str, int]
    patience: Patience


def add_model_options(group: OptionGroup) -> None:
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
    """Convert the options of models to fields of `RunConfig`.

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


USUAL_CONCURRENCY = min(4, os.cpu_count() or 1)
"""Default number of episodes played at a time."""


def add_external_options(run: argparse.ArgumentParser) -> None:
    """Declare the options of external agents: the command after `--` and its limits."""
    group = run.add_argument_group(
        "external agents",
        "Play with a program that speaks MCP, such as a command-line coding agent:\n"
        "  physment-eval run --agent external --server host -- COMMAND …\n"
        "In COMMAND, {mcp_config} is replaced by the path of a client configuration, {mcp_url}\n"
        "by the address of the episode, and {prompt} by the opening prompt. Without {prompt},\n"
        "the prompt is written to its stdin. The environment variables\n"
        f"{URL} and {TOKEN} hold the address, and the token if it needs one.\n"
        "Each episode has an empty working folder, home and temporary folder of its own, and\n"
        "the record is the host's log of its calls.",
    )
    group.add_argument("command_words", nargs="*", metavar="-- COMMAND", help="the program and its arguments")
    group.add_argument(
        "--max-calls",
        type=count_of("calls"),
        metavar="N",
        help="most tool calls in an episode (default: the scene's own limit and the answer; where it has none,"
        f" {CALLS_PER_ITERATION} × the budget of iterations)",
    )
    group.add_argument(
        "--max-wall-time", type=seconds, default=1800.0, metavar="S", help="most wall time for an episode [s] (1800)"
    )
    group.add_argument(
        "--home-template",
        type=Path,
        metavar="DIR",
        help="folder whose content each new home starts with, such as the files of a login (default: an empty home)",
    )
    group.add_argument(
        "--same-seeds",
        action="store_true",
        help="play the same seeds at each budget and epoch (default: seeds of their own for each after the first, so"
        " that nothing learned in one helps in another)",
    )
    group.add_argument(
        "--sealed",
        action="store_true",
        help="you vouch that COMMAND cannot read any scene pack, because it runs in a container or as another user;"
        " without this, an agent that could read the packs is marked unsealed",
    )
    group.add_argument(
        "--sealed-users",
        default="",
        metavar="USER,…",
        help="system users that COMMAND runs as, one for each episode played at a time (needs root)",
    )


def usual_concurrency(args: argparse.Namespace) -> int:
    """Return the default number of concurrent episodes; for isolated programs, the number of their system users."""
    return max(1, len(_users(args))) if args.sealed else USUAL_CONCURRENCY


def check_sealed(args: argparse.Namespace) -> None:
    """Refuse options under which isolated programs could communicate with each other.

    Raises:
        UsageError: The programs could communicate, or their options contradict each other.
    """
    users, asked = _users(args), args.concurrency
    if users and not args.sealed:
        raise UsageError("--sealed-users belongs to --sealed: you vouch that these users cannot read any scene pack")
    if users and args.executor != "local":
        raise UsageError("--sealed-users: these are users of this machine, so play with --executor local")
    if args.sealed and asked is not None and asked > max(1, len(users)):
        raise UsageError(
            f"--sealed --concurrency {asked}: programs of one user can read each other's tokens and take over each"
            f" other's episodes; name {asked} system users with --sealed-users, or play one episode at a time"
        )


def _users(args: argparse.Namespace) -> list[str]:
    return list(filter(None, args.sealed_users.split(",")))
