"""`physment-mcp preview`: shows the app of the laboratory in a local page, as a chat client does."""

import argparse
import functools
import os
import secrets
import socket
import sys
import webbrowser
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import anyio

from physment_mcp.commands.base import Commands, common_options, port, scene_id, timestep, whole_number
from physment_mcp.errors import UsageError

if TYPE_CHECKING:
    from collections.abc import AsyncGenerator

    from mcp import Client
    from mcp.server import Server
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import Response

_PAGE = Path(__file__).parent / "preview.html"
"""Built from `viewer/` by `make viewer`."""
_MOST_BODY = 64_000
"""Largest accepted call [bytes]."""
_HEADERS = {"cache-control": "no-store", "referrer-policy": "no-referrer", "x-content-type-options": "nosniff"}
_DESCRIPTION = """\
Show the app of the laboratory in a local page, as a chat client shows it: a frame with the scene, and a form that calls
tools as the model would.

  physment-mcp preview 7
  physment-mcp preview 21 --seed 3 --no-open

The page is for this machine alone, and its address holds a token. Ctrl-C ends it. Nothing is recorded; to solve a scene
and have it graded, use physment-eval play.
"""


def add(commands: Commands) -> None:
    """Declare `preview`."""
    preview = commands.add_parser(
        "preview",
        parents=[common_options(again=True)],
        help="show the app of the chat in a local page",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    preview.add_argument("scene", type=scene_id, metavar="N", help="scene to open, or world:5:17")
    preview.add_argument("--seed", type=whole_number, default=0, metavar="S", help="variant of the scene (default 0)")
    preview.add_argument("--port", type=port, default=0, help="port (default: any free one)")
    preview.add_argument("--no-open", action="store_true", help="print the address, and open no browser")
    timestep(preview, again=True)
    preview.set_defaults(run=_preview)


def _preview(args: argparse.Namespace) -> int:
    import uvicorn  # noqa: PLC0415 - --help need not wait for the engine

    from physment_mcp.scene import load_scene  # noqa: PLC0415
    from physment_mcp.serving.server import build_server  # noqa: PLC0415
    from physment_mcp.serving.slot import EpisodeSlot  # noqa: PLC0415
    from physment_mcp.session import Session  # noqa: PLC0415
    from physment_mcp.visibility import cached_visibility  # noqa: PLC0415

    session = Session(load_scene(args.scene, args.seed, args.scenes_dir, args.timestep))
    server = build_server(EpisodeSlot(session, find_visibility=cached_visibility(args.scenes_dir)))
    token = secrets.token_urlsafe(16)
    try:
        listener = socket.create_server(("127.0.0.1", args.port))
    except OSError as error:
        raise UsageError(f"cannot listen on 127.0.0.1 port {args.port}: {error.strerror}") from error
    with listener:
        address = f"http://127.0.0.1:{listener.getsockname()[1]}/{token}/"
        print(f"the app is shown at {address} until Ctrl-C", flush=True)
        if not args.no_open and _has_display():
            webbrowser.open(address)
        app = preview_app(server, token, session.scene.public.name)
        config = uvicorn.Config(app, log_config=None, log_level="warning", timeout_graceful_shutdown=1)
        anyio.run(functools.partial(uvicorn.Server(config).serve, sockets=[listener]))
    return 0


def preview_app(server: "Server[Any]", token: str, title: str) -> "Starlette":
    """Build the ASGI application that shows the app of a server.

    Args:
        server: The MCP server of one episode.
        token: First segment of every path.
        title: Name of the scene.
    """
    from mcp import Client  # noqa: PLC0415
    from mcp.client.extension import advertise  # noqa: PLC0415
    from starlette.applications import Starlette  # noqa: PLC0415
    from starlette.middleware import Middleware  # noqa: PLC0415
    from starlette.responses import HTMLResponse  # noqa: PLC0415
    from starlette.routing import Route  # noqa: PLC0415

    from physment_mcp.contract.names import APP_TYPE, APPS  # noqa: PLC0415
    from physment_mcp.serving.http_guard import HttpGuard  # noqa: PLC0415

    host = _Host(title)

    @asynccontextmanager
    async def connected(_app: "Starlette") -> "AsyncGenerator[None]":
        async with AsyncExitStack() as stack:
            extension = advertise(APPS, {"mimeTypes": [APP_TYPE]})
            host.client = await stack.enter_async_context(Client(server, extensions=[extension]))
            yield

    async def page(_request: "Request") -> "Response":
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

    client: "Client"

    def __init__(self, title: str) -> None:
        self._title = title

    async def state(self, _request: "Request") -> "Response":
        """Return the prompt, the tools, and the tools whose results the app shows."""
        from physment_mcp.serving.lab_app import SHOWING  # noqa: PLC0415

        tools = [
            {"name": tool.name, "description": tool.description, "input_schema": tool.input_schema}
            for tool in (await self.client.list_tools()).tools
        ]
        prompt = await self.client.get_prompt("scene")
        (text,) = [message.content.model_dump()["text"] for message in prompt.messages]
        return _json({"title": self._title, "prompt": text, "tools": tools, "showing": sorted(SHOWING)})

    async def app(self, _request: "Request") -> "Response":
        """Return the page of the app, in a sandbox without access to this origin."""
        from starlette.responses import HTMLResponse  # noqa: PLC0415

        from physment_mcp.serving.lab_app import APP_URI  # noqa: PLC0415

        content = (await self.client.read_resource(APP_URI)).contents[0]
        headers = {**_HEADERS, "content-security-policy": "sandbox allow-scripts"}
        return HTMLResponse(content.model_dump()["text"], headers=headers)

    async def view(self, request: "Request") -> "Response":
        """Return the current view, as the app reads it."""
        from physment_mcp.contract.names import VIEW_URI  # noqa: PLC0415

        del request
        content = (await self.client.read_resource(VIEW_URI)).contents[0]
        return _json({"text": content.model_dump()["text"]})

    async def call(self, request: "Request") -> "Response":
        """Call a tool and return its result, as a client passes it to the app; 400 and a sentence for another body."""
        from mcp.shared.exceptions import MCPError  # noqa: PLC0415

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


def _json(content: Any, status: int = 200) -> "Response":
    from starlette.responses import JSONResponse  # noqa: PLC0415

    return JSONResponse(content, status, headers=_HEADERS)


async def _admit_all(_path: str) -> None:
    await anyio.lowlevel.checkpoint()


def _has_display() -> bool:
    """Whether a graphical browser can open: a text browser would occupy the terminal."""
    return sys.platform in {"win32", "darwin"} or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))
