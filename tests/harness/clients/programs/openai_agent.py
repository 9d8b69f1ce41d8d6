"""An agent of the OpenAI Agents SDK with the laboratory as its MCP server."""

import asyncio
import shlex
import sys

from agents import Agent, ModelSettings, Runner, set_default_openai_api, set_tracing_disabled
from agents.mcp import MCPServerStdio, MCPServerStreamableHttp

laboratory, task = sys.argv[1:]
set_default_openai_api("chat_completions")
set_tracing_disabled(disabled=True)


def connect():
    # The SDK's default timeout of five seconds is too short for a long experiment.
    if laboratory.startswith("http"):
        return MCPServerStreamableHttp({"url": laboratory}, client_session_timeout_seconds=300)
    command, *args = shlex.split(laboratory)
    return MCPServerStdio({"command": command, "args": args}, client_session_timeout_seconds=300)


async def main() -> None:
    async with connect() as server:
        one_at_a_time = ModelSettings(parallel_tool_calls=False)
        agent = Agent("experimenter", model="gpt-5.5", mcp_servers=[server], model_settings=one_at_a_time)
        print((await Runner.run(agent, task, max_turns=100)).final_output)


asyncio.run(main())
