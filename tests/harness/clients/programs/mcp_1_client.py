"""The `mcp` 1.x client with a minimal agent loop: ask the model, call the tool, return the result to the model."""

import asyncio
import json
import shlex
import sys

from mcp import ClientSession, StdioServerParameters
from mcp.client.stdio import stdio_client
from mcp.client.streamable_http import streamable_http_client
from openai import OpenAI

laboratory, task = sys.argv[1:]


def connect():
    if laboratory.startswith("http"):
        return streamable_http_client(laboratory)
    command, *args = shlex.split(laboratory)
    return stdio_client(StdioServerParameters(command=command, args=args))


async def main() -> None:
    model, messages = OpenAI(), [{"role": "user", "content": task}]
    async with connect() as (read, write, *_), ClientSession(read, write) as session:
        await session.initialize()
        tools = [
            {
                "type": "function",
                "function": {"name": t.name, "description": t.description, "parameters": t.inputSchema},
            }
            for t in (await session.list_tools()).tools
        ]
        while True:
            reply = model.chat.completions.create(model="gpt-5.5", messages=messages, tools=tools).choices[0].message
            messages.append(reply.model_dump(exclude_none=True))
            if not reply.tool_calls:
                return print(reply.content)
            for call in reply.tool_calls:
                result = await session.call_tool(call.function.name, json.loads(call.function.arguments))
                text = "\n".join(part.text for part in result.content if part.type == "text")
                messages.append({"role": "tool", "tool_call_id": call.id, "content": text})


asyncio.run(main())
