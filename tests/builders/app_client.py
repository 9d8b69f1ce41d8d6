"""A client that declares MCP Apps, as chat clients do."""

from typing import Any

from mcp import Client
from mcp.client.extension import advertise

EXTENSION = "io.modelcontextprotocol/ui"
MIME_TYPE = "text/html;profile=mcp-app"


def app_client(server: Any, mode: Any = "auto") -> Client:
    """A client of a server that shows apps in HTML."""
    return Client(server, mode=mode, extensions=[advertise(EXTENSION, {"mimeTypes": [MIME_TYPE]})])
