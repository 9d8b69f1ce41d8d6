"""A smolagents agent that calls the laboratory's tools."""

import shlex
import sys

from mcp import StdioServerParameters
from smolagents import MCPClient, OpenAIModel, ToolCallingAgent

laboratory, task = sys.argv[1:]


def parameters():
    if laboratory.startswith("http"):
        return {"url": laboratory, "transport": "streamable-http"}
    command, *args = shlex.split(laboratory)
    return StdioServerParameters(command=command, args=args)


with MCPClient(parameters(), structured_output=False) as tools:
    for tool in tools:
        for argument in tool.inputs.values():
            if "anyOf" in argument:  # the adapter takes it as a text, and would refuse a number as answer
                argument["type"] = "any"
            if "default" in argument:  # otherwise the adapter requires all arguments
                argument["nullable"] = True
    # Otherwise the calls of one reply run in parallel, in any order.
    agent = ToolCallingAgent(tools, OpenAIModel("gpt-5.5"), max_steps=100, max_tool_threads=1, verbosity_level=0)
    print(agent.run(task))
