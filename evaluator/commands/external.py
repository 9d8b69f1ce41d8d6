"""What `run` says of agents that are programs: `--agent external -- COMMAND`, and its options."""

import argparse

from evaluator.agents.external.agent import CALLS_PER_ITERATION
from evaluator.commands.argument_types import count_of, seconds


def add_options(run: argparse.ArgumentParser) -> None:
    """Declare the command after `--`, and its bounds."""
    group = run.add_argument_group(
        "external agents",
        "Play with a program that speaks MCP, such as a command-line coding agent:\n"
        "  physment-eval run --agent external --server host -- COMMAND …\n"
        "In COMMAND, {mcp_config} stands for the path of a client configuration, {mcp_url} for\n"
        "the address of the episode, and {prompt} for the opening prompt, which otherwise comes\n"
        "on its stdin. It runs in an empty folder and is judged by the host's log of its calls.",
    )
    group.add_argument("command_words", nargs="*", metavar="-- COMMAND", help="the program and its arguments")
    group.add_argument(
        "--max-calls",
        type=count_of("calls"),
        metavar="N",
        help=f"most tool calls in an episode (default {CALLS_PER_ITERATION} × its budget of iterations)",
    )
    group.add_argument(
        "--max-wall-time", type=seconds, default=1800.0, metavar="S", help="most wall time for an episode [s] (1800)"
    )
    group.add_argument(
        "--sealed",
        action="store_true",
        help="you vouch that no scene pack can be read where COMMAND runs, such as in a container or as another user;"
        " without it an agent that could read the packs is marked unsealed",
    )
