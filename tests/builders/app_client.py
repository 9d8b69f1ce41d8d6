"""A client that declares MCP Apps, as chat clients do."""

from typing import Any

from mcp import Client
from mcp.client.extension import advertise

from physment_mcp.contract.names import APP_TYPE, APPS


def app_client(server: Any, mode: Any = "auto") -> Client:
    """Create a client that declares support of HTML apps."""
    return Client(server, mode=mode, extensions=[advertise(APPS, {"mimeTypes": [APP_TYPE]})])
