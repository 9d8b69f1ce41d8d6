"""A pydantic-ai agent; the laboratory is one of its toolsets."""

import shlex
import sys

from fastmcp.client.transports import StdioTransport
from pydantic_ai import Agent
from pydantic_ai.mcp import MCPToolset

laboratory, task = sys.argv[1:]
if not laboratory.startswith("http"):
    command, *args = shlex.split(laboratory)
    laboratory = StdioTransport(command, args)
# A refusal is something to learn from, and no failure of the run.
agent = Agent("openai-chat:gpt-5.5", toolsets=[MCPToolset(laboratory, tool_error_behavior="failed")])
# Calls of one reply would run side by side, in any order.
print(agent.run_sync(task, model_settings={"parallel_tool_calls": False}).output)
