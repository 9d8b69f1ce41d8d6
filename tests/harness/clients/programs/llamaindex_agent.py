"""A LlamaIndex agent with the tools of the laboratory. Its client reconnects for each call, so give it a URL."""

import asyncio
import os
import shlex
import sys

from llama_index.core.agent.workflow import FunctionAgent
from llama_index.llms.openai import OpenAI
from llama_index.tools.mcp import BasicMCPClient, McpToolSpec

laboratory, task = sys.argv[1:]


async def main() -> None:
    command_or_url, *args = shlex.split(laboratory)
    tools = await McpToolSpec(BasicMCPClient(command_or_url, args, timeout=300)).to_tool_list_async()
    agent = FunctionAgent(
        tools=tools,
        llm=OpenAI("gpt-5.5", api_base=os.environ.get("OPENAI_BASE_URL")),
        streaming=False,
        allow_parallel_tool_calls=False,
    )
    print(await agent.run(task, max_iterations=100))


asyncio.run(main())
