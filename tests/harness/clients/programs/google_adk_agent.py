"""An agent of Google's ADK with the laboratory as its MCP toolset."""

import asyncio
import shlex
import sys

from google.adk.agents import Agent
from google.adk.runners import InMemoryRunner
from google.adk.tools.mcp_tool import McpToolset, StdioConnectionParams, StreamableHTTPConnectionParams
from mcp import StdioServerParameters

laboratory, task = sys.argv[1:]


def connect():
    # The toolset's default timeout of five seconds is too short for a long experiment.
    if laboratory.startswith("http"):
        return StreamableHTTPConnectionParams(url=laboratory, timeout=300)
    command, *args = shlex.split(laboratory)
    return StdioConnectionParams(server_params=StdioServerParameters(command=command, args=args), timeout=300)


async def main() -> None:
    toolset = McpToolset(connection_params=connect())
    agent = Agent(name="experimenter", model="gemini-3.1-pro", tools=[toolset])
    async with InMemoryRunner(agent=agent) as runner:
        for event in await runner.run_debug(task, quiet=True):
            if event.is_final_response() and event.content:
                print(event.content.parts[0].text)


asyncio.run(main())
