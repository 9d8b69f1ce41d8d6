"""A LangChain agent with the tools of the laboratory, in one session."""

import asyncio
import shlex
import sys

from langchain.agents import create_agent
from langchain_mcp_adapters.client import MultiServerMCPClient
from langchain_mcp_adapters.tools import load_mcp_tools
from langchain_openai import ChatOpenAI

laboratory, task = sys.argv[1:]


def parameters():
    if laboratory.startswith("http"):
        return {"transport": "http", "url": laboratory}
    command, *args = shlex.split(laboratory)
    return {"transport": "stdio", "command": command, "args": args}


async def main() -> None:
    # Without the session, `client.get_tools()` would start a server for every call.
    async with MultiServerMCPClient({"physment": parameters()}).session("physment") as session:
        one_at_a_time = ChatOpenAI(model="gpt-5.5", model_kwargs={"parallel_tool_calls": False})
        agent = create_agent(one_at_a_time, await load_mcp_tools(session))
        said = await agent.ainvoke({"messages": [("user", task)]}, {"recursion_limit": 200})
        print(said["messages"][-1].content)


asyncio.run(main())
