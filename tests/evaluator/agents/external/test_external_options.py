"""Tests that the command line of an external agent is passed on unchanged."""

import argparse
import sys
from pathlib import Path

import pytest

from evaluator.agents.external.agent import ExternalAgent
from evaluator.commands.program import Parser
from evaluator.commands.run_options import add_options, read_options
from evaluator.errors import UsageError
from evaluator.study.run_config import participants_of


def parsed(*words: str) -> argparse.Namespace:
    """Parse the arguments as `physment-eval run` does: below a sub-command."""
    parser = Parser()
    add_options(parser.add_subparsers().add_parser("run"))
    return parser.parse_args(["run", "--server", "host", *words])


def external_agent(args: argparse.Namespace) -> ExternalAgent:
    (agent,) = participants_of(read_options(args, {})).values()
    assert isinstance(agent, ExternalAgent)
    return agent


def test_the_words_after_the_dashes_are_passed_to_the_program_unchanged() -> None:
    own = ["--print", "--agent", "x", "--", "{mcp_url}", "-h", ""]
    agent = external_agent(parsed("--agent", "external", "--", sys.executable, *own))
    assert agent.command == (sys.executable, *own)
    assert (agent.max_calls, agent.max_wall_s) == (None, 1800.0)
    assert agent.unsealed


def test_limits_and_the_operators_voucher_are_options() -> None:
    options = ("--max-calls", "7", "--max-wall-time", "2.5", "--sealed")
    agent = external_agent(parsed("--agent", "external", *options, "--", sys.executable, "{mcp_config}"))
    assert (agent.max_calls, agent.max_wall_s, agent.unsealed) == (7, 2.5, None)


@pytest.mark.parametrize("value", ["0", "-1", "nan", "inf", "soon"])
def test_a_wall_time_that_is_not_a_time_is_refused(value: str) -> None:
    with pytest.raises(UsageError, match="is not a time above 0"):
        parsed("--max-wall-time", value)


def test_only_an_external_agent_has_a_command_and_it_has_no_stopping_policy() -> None:
    with pytest.raises(UsageError, match="belongs to --agent external"):
        participants_of(read_options(parsed("--agent", "random", "--", sys.executable), {}))
    words = ("--agent", "external", "--stopping", "budget-aware", "--", sys.executable, "{mcp_url}")
    with pytest.raises(UsageError, match="cannot be told when to answer"):
        participants_of(read_options(parsed(*words), {}))


def test_a_program_meets_other_seeds_at_each_budget_and_epoch_unless_it_is_told_otherwise() -> None:
    words = ("--agent", "external", "--agent", "random", "--scenes", "7,8", "--seeds", "0,3", "--budgets", "5,20")
    words = (*words, "--epochs", "2")

    def seeds(*more: str) -> dict[str, list[int]]:
        options = read_options(parsed(*words, *more, "--", sys.executable, "{mcp_url}"), {})
        keys = options.plan(participants_of(options)).matrix()
        assert len(keys) == len(set(keys)) == 32
        return {agent: [key.seed for key in keys if key.agent == agent and key.scene == 7] for agent in agents}

    agents = list(participants_of(read_options(parsed(*words, "--", sys.executable, "{mcp_url}"), {})))
    own = seeds()
    program = next(name for name in own if name.startswith("external"))
    assert own["random"] == [0, 3] * 4
    assert own[program][:2] == [0, 3]
    assert len(set(own[program])) == 8
    assert seeds("--same-seeds")[program] == [0, 3] * 4


def test_a_home_to_start_with_must_be_a_folder(tmp_path: Path) -> None:
    words = ("--agent", "external", "--home-template", str(tmp_path / "none"), "--", sys.executable, "{mcp_url}")
    with pytest.raises(UsageError, match="there is no such folder"):
        external_agent(parsed(*words))
