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
# The agent should learn from a refusal; it must not end the run.
agent = Agent("openai-chat:gpt-5.5", toolsets=[MCPToolset(laboratory, tool_error_behavior="failed")])
# Otherwise the calls of one reply run in parallel, in any order.
print(agent.run_sync(task, model_settings={"parallel_tool_calls": False}).output)
