"""The 26 tools of the laboratory, under their own names, for every rollout of an environment worker.

One process serves all rollouts. Each call has the state of its rollout, which contains the address of its episode.
"""

import contextlib
import functools
import ssl
from collections.abc import AsyncIterator
from typing import Any, cast

import httpx2
import verifiers.v1 as vf
from mcp import Client
from mcp.client.streamable_http import streamable_http_client
from mcp.server.mcpserver import Context, MCPServer
from mcp.types import CallToolResult, Tool
from physment_referee import ANSWER

_PATIENCE = httpx2.Timeout(30.0, read=300.0)
"""[s]; a long `step` of a stiff scene takes minutes."""


@functools.cache
def _trust() -> ssl.SSLContext:
    """The trusted certificate authorities, cached because reading them takes 20 ms and each call has its own client."""
    return httpx2.create_ssl_context()


class LaboratoryState(vf.State):
    """The episode of a rollout, which the model does not see."""

    episode_id: str = ""
    owner_token: str = ""
    mcp_url: str = ""
    player_token: str = ""
    prompt: str = ""
    answered: bool = False


class LaboratoryToolset(vf.Toolset[vf.SharedToolsetConfig, LaboratoryState]):
    """Passes calls on to the host."""

    TOOL_PREFIX = None

    def register(self, mcp: MCPServer) -> None:
        """Forward the host's tools. The server calls these two methods for every request."""
        server = cast(Any, mcp)
        server.list_tools = self._with_state(self.list_tools)
        server.call_tool = self._with_state(self.call_tool)

    async def list_tools(self) -> list[Tool]:
        """The tools, with the schemas of the host."""
        async with self._laboratory() as client:
            return (await client.list_tools()).tools

    async def call_tool(self, name: str, arguments: dict[str, Any], context: Context | None = None) -> CallToolResult:
        """Run a call. An answer that the laboratory accepts ends the rollout."""
        del context
        async with self._laboratory() as client:
            result = await client.call_tool(name, arguments)
        self.state.answered = self.state.answered or (name == ANSWER and not result.is_error)
        return result

    @contextlib.asynccontextmanager
    async def _laboratory(self) -> AsyncIterator[Client]:
        headers = {"Authorization": f"Bearer {self.state.player_token}"}
        async with (
            httpx2.AsyncClient(headers=headers, timeout=_PATIENCE, verify=_trust()) as http,
            Client(streamable_http_client(self.state.mcp_url, http_client=http)) as client,
        ):
            yield client


if __name__ == "__main__":
    LaboratoryToolset.run()
