"""The page of `physment-mcp preview`: an MCP client that shows the app of the laboratory, as a chat client does."""

from collections.abc import AsyncGenerator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import anyio
from mcp import Client, MCPError
from mcp.client.extension import advertise
from mcp.server import Server
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, Response
from starlette.routing import Route

from physment_mcp.contract.names import APP_TYPE, APPS, VIEW_URI
from physment_mcp.serving.http_guard import HttpGuard
from physment_mcp.serving.resources import APP_URI, SHOWING

_PAGE = Path(__file__).parent / "preview.html"
"""Built from `viewer/` by `make viewer`."""
_MOST_BODY = 64_000
"""Largest accepted call [bytes]."""
_HEADERS = {"cache-control": "no-store", "referrer-policy": "no-referrer", "x-content-type-options": "nosniff"}


def preview_app(server: Server[Any], token: str, title: str) -> Starlette:
    """Build the ASGI application that shows the app of a server.

    Args:
        server: The MCP server of one episode.
        token: First segment of every path.
        title: Name of the scene.
    """
    host = _Host(title)

    @asynccontextmanager
    async def connected(_app: Starlette) -> AsyncGenerator[None]:
        async with AsyncExitStack() as stack:
            extension = advertise(APPS, {"mimeTypes": [APP_TYPE]})
            host.client = await stack.enter_async_context(Client(server, extensions=[extension]))
            yield

    async def page(_request: Request) -> Response:
        await anyio.lowlevel.checkpoint()
        return HTMLResponse(_PAGE.read_bytes(), headers=_HEADERS)

    routes = [
        Route(f"/{token}/", page),
        Route(f"/{token}/state", host.state),
        Route(f"/{token}/app", host.app),
        Route(f"/{token}/view", host.view),
        Route(f"/{token}/call", host.call, methods=["POST"]),
    ]
    return Starlette(routes=routes, lifespan=connected, middleware=[Middleware(HttpGuard, _admit_all, most=_MOST_BODY)])


class _Host:
    """The MCP client behind the page."""

    client: Client

    def __init__(self, title: str) -> None:
        self._title = title

    async def state(self, _request: Request) -> Response:
        """Return the prompt, the tools, and the tools whose results the app shows."""
        tools = [
            {"name": tool.name, "description": tool.description, "input_schema": tool.input_schema}
            for tool in (await self.client.list_tools()).tools
        ]
        prompt = await self.client.get_prompt("scene")
        (text,) = [message.content.model_dump()["text"] for message in prompt.messages]
        return _json({"title": self._title, "prompt": text, "tools": tools, "showing": sorted(SHOWING)})

    async def app(self, _request: Request) -> Response:
        """Return the page of the app, in a sandbox without access to this origin."""
        content = (await self.client.read_resource(APP_URI)).contents[0]
        headers = {**_HEADERS, "content-security-policy": "sandbox allow-scripts"}
        return HTMLResponse(content.model_dump()["text"], headers=headers)

    async def view(self, request: Request) -> Response:
        """Return the current view, as the app reads it."""
        del request
        content = (await self.client.read_resource(VIEW_URI)).contents[0]
        return _json({"text": content.model_dump()["text"]})

    async def call(self, request: Request) -> Response:
        """Call a tool and return its result, as a client passes it to the app; status 400 if the body is malformed."""
        try:
            wanted: Any = await request.json()
            tool, arguments = str(wanted["tool"]), dict(wanted["arguments"])
        except (ValueError, TypeError, KeyError):
            return _json({"error": 'the body must be {"tool": NAME, "arguments": {…}}'}, 400)
        try:
            result = await self.client.call_tool(tool, arguments)
        except MCPError as error:
            return _json({"error": str(error)}, 400)
        return _json(result.model_dump(mode="json", by_alias=True, exclude_none=True))


def _json(content: Any, status: int = 200) -> Response:
    return JSONResponse(content, status, headers=_HEADERS)


async def _admit_all(_path: str) -> None:
    await anyio.lowlevel.checkpoint()
