"""The options of `run` for external agents: `--agent external -- COMMAND`."""

import argparse

from evaluator.agents.external.agent import CALLS_PER_ITERATION
from evaluator.commands.argument_types import count_of, seconds


def add_options(run: argparse.ArgumentParser) -> None:
    """Declare the command after `--`, and its limits."""
    group = run.add_argument_group(
        "external agents",
        "Play with a program that speaks MCP, such as a command-line coding agent:\n"
        "  physment-eval run --agent external --server host -- COMMAND …\n"
        "In COMMAND, {mcp_config} is replaced by the path of a client configuration, {mcp_url}\n"
        "by the address of the episode, and {prompt} by the opening prompt. Without {prompt},\n"
        "the prompt is written to its stdin. The command runs in an empty folder, and the record\n"
        "is the host's log of its calls.",
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
        "--sealed",
        action="store_true",
        help="you vouch that COMMAND cannot read any scene pack, because it runs in a container or as another user;"
        " without this, an agent that could read the packs is marked unsealed",
    )
