"""Tests of the how-to pages on external agents and on playing."""

import re
import shlex
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from evaluator.agents.external.agent import parse_external
from evaluator.episode.hosts import HostConnector
from evaluator.episode.player import ToolDescription
from evaluator.episode.protocols.typed import parse_line
from evaluator.records.episode import Outcome
from physment_mcp.serving.server import published_tools
from tests.builders.commands import physment_eval
from tests.builders.paths import DOCS
from tests.builders.records import VERSIONS, episode_key

TOOLS = tuple(ToolDescription(tool.name, tool.description or "", tool.input_schema) for tool in published_tools())
PAGE = (DOCS / "how-to" / "external-agents.md").read_text(encoding="utf-8")


async def test_the_smallest_agent_on_the_page_solves_its_scene(
    host: HostConnector, program: Callable[..., list[str]]
) -> None:
    (source,) = re.findall(r"```python file=my_agent\.py\n(.*?)```", PAGE, re.DOTALL)
    agent = parse_external(program(source, "{mcp_url}"), "host", None)
    key = episode_key(agent=agent.name)
    episode = await agent.play(host, key, VERSIONS, [])
    assert (episode.outcome, episode.answer) == (Outcome.ANSWERED, pytest.approx(7.848, rel=0.05))


def test_the_commands_on_the_page_are_valid() -> None:
    commands = [
        shlex.split(line.partition(" -- ")[2])
        for line in PAGE.replace("\\\n", "").splitlines()
        if line.startswith("physment-eval run") and "COMMAND" not in line
    ]
    assert len(commands) == 2
    for _program, *words in commands:
        assert parse_external([sys.executable, *words], "host", None).command[1:] == tuple(words)


def test_what_the_page_on_playing_shows_is_what_a_person_sees(tmp_path: Path, host_url: str) -> None:
    page = (DOCS / "how-to" / "human-baseline.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"```text\n(.*?)```", page, re.DOTALL)
    typed = "".join(f"{line}\n" for line in re.findall(r"left > (.*)", shown))
    done = physment_eval("play", "7", "--server", host_url, "--out", "run", typed=typed, cwd=tmp_path)
    seen = done.stdout[done.stdout.index("20 iterations left") :]
    # A pipe does not echo what is typed into it.
    assert seen.startswith(re.sub(r"(left > ).*\n", r"\1", shown))
    for line in re.findall(r"`((?:apply_force|attach_objects) .*?)`", page):
        assert parse_line(line, TOOLS)
