"""A minimal typed MCP server with one tool that returns a constant: the baseline for the laboratory's speed.

The tool has input and output schemas like the laboratory's tools, so the client spends the same time on validation.

python bare_server.py          on stdio
python bare_server.py http     over HTTP, one session manager at /mcp; prints its address as one JSON line
"""

import contextlib
import json
import sys
from collections.abc import AsyncGenerator
from typing import Any

import anyio
import mcp_types as types
from mcp.server import ServerRequestContext
from mcp.server.lowlevel import Server

READING = {"sim_time": 0.5, "velocity": [0.0, 0.0, -4.905]}
OUTPUT = {
    "type": "object",
    "properties": {
        "sim_time": {"type": "number"},
        "velocity": {"type": "array", "items": {"type": "number"}, "minItems": 3, "maxItems": 3},
    },
    "required": ["sim_time", "velocity"],
    "additionalProperties": False,
}


async def _list_tools(_ctx: ServerRequestContext[Any], _params: Any) -> types.ListToolsResult:
    tool = types.Tool(name="get_velocity", input_schema={"type": "object"}, output_schema=OUTPUT)
    return types.ListToolsResult(tools=[tool])


async def _call_tool(_ctx: ServerRequestContext[Any], _params: types.CallToolRequestParams) -> types.CallToolResult:
    text = types.TextContent(type="text", text=json.dumps(READING, separators=(",", ":")))
    return types.CallToolResult(content=[text], structured_content=READING)


def bare_server() -> Server[Any]:
    """A server with one tool and no state."""
    return Server("bare", on_list_tools=_list_tools, on_call_tool=_call_tool)


async def _stdio() -> None:
    from mcp.server.stdio import stdio_server

    server = bare_server()
    async with stdio_server() as (read, write):
        await server.run(read, write, server.create_initialization_options())


def _http() -> None:
    import uvicorn
    from mcp.server.streamable_http_manager import StreamableHTTPSessionManager
    from starlette.applications import Starlette
    from starlette.routing import Route

    manager = StreamableHTTPSessionManager(bare_server())

    @contextlib.asynccontextmanager
    async def lifespan(_app: Starlette) -> AsyncGenerator[None]:
        async with manager.run():
            yield

    class Announcing(uvicorn.Server):
        async def startup(self, sockets: Any = None) -> None:
            await super().startup(sockets)
            host, port = self.servers[0].sockets[0].getsockname()
            print(json.dumps({"listening": f"http://{host}:{port}/mcp"}), flush=True)

    class Endpoint:
        async def __call__(self, scope: Any, receive: Any, send: Any) -> None:
            await manager.handle_request(scope, receive, send)

    app = Starlette(routes=[Route("/mcp", Endpoint())], lifespan=lifespan)
    Announcing(uvicorn.Config(app, port=0, log_level="warning")).run()


if __name__ == "__main__":
    if sys.argv[1:] == ["http"]:
        _http()
    else:
        anyio.run(_stdio)
