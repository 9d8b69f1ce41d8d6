"""Runs the host as `physment-mcp serve` does, and records the protocol version of each call.

python watched_host.py FILE    serves on a free port, prints its address, appends a JSON line for each POST to FILE
"""

import json
import sys
from pathlib import Path

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from physment_mcp.serving.episode_server import EpisodeServer
from physment_mcp.serving.listening import serve


class WatchedHost(EpisodeServer):
    """A host that records each POST."""

    notes: Path

    def app(self) -> Starlette:
        application = super().app()
        application.add_middleware(_Notes, notes=self.notes)
        return application


class _Notes:
    def __init__(self, app: ASGIApp, notes: Path) -> None:
        self._app, self._notes = app, notes

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http" or scope["method"] != "POST" or not scope["path"].endswith("/mcp"):
            await self._app(scope, receive, send)
            return
        body = bytearray()

        async def heard() -> Message:
            message = await receive()
            body.extend(message.get("body", b""))
            return message

        await self._app(scope, heard, send)
        said = json.loads(body)
        note = {"method": said.get("method"), "version": Request(scope).headers.get("mcp-protocol-version")}
        with self._notes.open("a", encoding="utf-8") as file:
            file.write(json.dumps(note) + "\n")


if __name__ == "__main__":
    host = WatchedHost()
    host.notes = Path(sys.argv[1])
    serve(host, "127.0.0.1", 0)
