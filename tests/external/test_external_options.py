"""The command line of an external agent: its words come through as they are."""

import argparse
import sys

import pytest

from evaluator.commands.external import add_options, external_agent


def parsed(*words: str) -> argparse.Namespace:
    """As `physment-eval run` parses them: below a sub-command."""
    parser = argparse.ArgumentParser()
    run = parser.add_subparsers().add_parser("run")
    run.add_argument("--agent")
    run.add_argument("--server", default="host")
    run.add_argument("--scenes-dir", default=None)
    add_options(run)
    return parser.parse_args(["run", *words])


def test_the_words_after_the_dashes_are_the_programs_own() -> None:
    own = ["--print", "--agent", "x", "--", "{mcp_url}", "-h", ""]
    agent = external_agent(parsed("--agent", "external", "--", sys.executable, *own))
    assert agent.command == (sys.executable, *own)
    assert (agent.max_calls, agent.max_wall_s) == (None, 1800.0)
    assert agent.unsealed


def test_its_bounds_and_the_operators_word_are_options() -> None:
    options = ("--max-calls", "7", "--max-wall-time", "2.5", "--sealed")
    agent = external_agent(parsed("--agent", "external", *options, "--", sys.executable, "{mcp_url}"))
    assert (agent.max_calls, agent.max_wall_s, agent.unsealed) == (7, 2.5, None)


@pytest.mark.parametrize("value", ["0", "-1", "nan", "inf", "soon"])
def test_a_wall_time_that_is_none_is_misuse(value: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        parsed("--max-wall-time", value)
    assert "is not a time above 0" in capsys.readouterr().err
