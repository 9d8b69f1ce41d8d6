"""Calls of an episode over MCP, for code without an event loop. One thread serves all open episodes."""

import contextlib
from collections.abc import AsyncIterator
from typing import Any

import httpx
from anyio.from_thread import BlockingPortalProvider
from mcp import ClientSession, McpError
from mcp.client.streamable_http import streamable_http_client
from mcp.types import CallToolResult, TextContent

_PATIENCE = httpx.Timeout(30.0, read=300.0)
"""[s]; a long `step` of a stiff scene takes minutes."""


_PORTALS = BlockingPortalProvider()
"""The event loop of all connections."""


@contextlib.asynccontextmanager
async def _connected(url: str, token: str) -> AsyncIterator[ClientSession]:
    headers = {"Authorization": f"Bearer {token}"}
    async with (
        httpx.AsyncClient(headers=headers, timeout=_PATIENCE) as http,
        streamable_http_client(url, http_client=http) as (read, write, _),
        ClientSession(read, write) as session,
    ):
        await session.initialize()
        yield session


class Laboratory:
    """A connection to one episode."""

    def __init__(self, mcp_url: str, player_token: str) -> None:
        """Connect.

        Args:
            mcp_url: Address of the episode.
            player_token: Bearer token of its requests.
        """
        with contextlib.ExitStack() as stack:
            self._portal = stack.enter_context(_PORTALS)
            connection = self._portal.wrap_async_context_manager(_connected(mcp_url, player_token))
            self._session = stack.enter_context(connection)
            self._closing = stack.pop_all()

    def call(self, tool: str, arguments: dict[str, Any]) -> tuple[str, dict[str, Any] | None, bool]:
        """Call a tool; returns the text for the model, the result as data, and whether the call was refused."""
        try:
            result: CallToolResult = self._portal.call(self._session.call_tool, tool, arguments)
        except McpError as error:
            return str(error), None, True
        text = "\n".join(part.text for part in result.content if isinstance(part, TextContent))
        return text, None if result.isError else result.structuredContent, result.isError

    def close(self) -> None:
        """Close the connection; the episode stays open."""
        with contextlib.suppress(Exception):  # the host may be gone
            self._closing.close()
