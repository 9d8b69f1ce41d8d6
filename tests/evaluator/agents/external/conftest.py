"""A shared host, and programs that play on it as external agents."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from evaluator.episode.hosts import HostConnector

PRELUDE = """
import json
import sys

import anyio
from mcp import Client

url = json.load(open(sys.argv[1]))["mcpServers"]["physment"]["url"]

async def play():
    async with Client(url) as client:
{body}

anyio.run(play)
"""


@pytest.fixture
def host(host_url: str) -> HostConnector:
    return HostConnector(host_url)


@pytest.fixture
def program(tmp_path: Path) -> Callable[..., list[str]]:
    """Return the command of a Python program; its first argument is the MCP configuration, its second the prompt."""

    def write(source: str, *words: str) -> list[str]:
        file = tmp_path / "program.py"
        file.write_text(source, encoding="utf-8")
        return [sys.executable, str(file), *(words or ("{mcp_config}", "{prompt}"))]

    return write


@pytest.fixture
def client(program: Callable[..., list[str]]) -> Callable[..., list[str]]:
    """Return the command of a program that opens an MCP client and runs the given lines."""

    def write(body: str, *words: str) -> list[str]:
        indented = "\n".join(f"        {line}" for line in body.strip().splitlines())
        return program(PRELUDE.format(body=indented), *words)

    return write
