"""A minimal HTTP/1.1 and MCP client. It takes less processor time of the measuring process than a library.

Implements the messages of the stateless protocol, and faulty uses of a connection.
"""

import asyncio
import itertools
import json
from collections.abc import Mapping
from typing import Any, NamedTuple, Self

PROTOCOL = "2026-07-28"
_META = {
    "io.modelcontextprotocol/protocolVersion": PROTOCOL,
    "io.modelcontextprotocol/clientInfo": {"name": "load", "version": "1"},
    "io.modelcontextprotocol/clientCapabilities": {},
}
_IDS = itertools.count(1)
_LONGEST_LINE = 2**20


class Reply(NamedTuple):
    """A response."""

    status: int
    headers: Mapping[str, str]
    body: bytes

    @property
    def failed(self) -> bool:
        """Whether the response is not the result of a successful tool call."""
        return self.status != 200 or b'"isError":false' not in self.body


class Connection:
    """An open connection to a host."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self.reader = reader
        self.writer = writer

    @classmethod
    async def dial(cls, port: int) -> Self:
        """Connect to a port on loopback."""
        return cls(*await asyncio.open_connection("127.0.0.1", port, limit=_LONGEST_LINE))

    async def ask(self, request: bytes) -> Reply:
        """Send a request and wait for the response.

        Raises:
            OSError: The connection broke.
            asyncio.IncompleteReadError: The host closed it in the middle of a response.
        """
        self.writer.write(request)
        await self.writer.drain()
        status, headers = await self.head()
        if headers.get("transfer-encoding") != "chunked":
            return Reply(status, headers, await self.reader.readexactly(int(headers.get("content-length", "0"))))
        body = b""
        while size := int(await self.reader.readuntil(b"\r\n"), 16):
            body += await self.reader.readexactly(size + 2)
        await self.reader.readuntil(b"\r\n")
        return Reply(status, headers, body)

    async def head(self) -> tuple[int, dict[str, str]]:
        """Read the status and the headers of a response."""
        first, *lines = (await self.reader.readuntil(b"\r\n\r\n")).decode("latin-1").splitlines()[:-1]
        headers = (line.partition(":") for line in lines)
        return int(first.split()[1]), {name.lower(): value.strip() for name, _, value in headers}

    def close(self) -> None:
        """Close the connection without waiting for it."""
        self.writer.close()

    def abort(self) -> None:
        """Reset the connection."""
        self.writer.transport.abort()


def request(method: str, path: str, body: bytes = b"", headers: Mapping[str, str] | None = None) -> bytes:
    """The bytes of a request."""
    lines = [f"{method} {path} HTTP/1.1", "Host: 127.0.0.1", f"Content-Length: {len(body)}"]
    lines += [f"{name}: {value}" for name, value in (headers or {}).items()]
    return ("\r\n".join(lines) + "\r\n\r\n").encode() + body


def message(path: str, method: str, params: Mapping[str, Any] | None = None, about: str | None = None) -> bytes:
    """The bytes of an MCP request without a session.

    Args:
        path: Path of the endpoint of an episode.
        method: MCP method.
        params: Its parameters.
        about: Name of the tool or prompt, or URI, that the protocol requires in a header.
    """
    content = {"jsonrpc": "2.0", "id": next(_IDS), "method": method, "params": {**(params or {}), "_meta": _META}}
    return posted(path, json.dumps(content).encode(), method, about)


def posted(path: str, body: bytes, method: str, about: str | None = None) -> bytes:
    """The bytes of an MCP request with this body."""
    headers = {
        "Accept": "application/json, text/event-stream",
        "Content-Type": "application/json",
        "Mcp-Protocol-Version": PROTOCOL,
        "Mcp-Method": method,
        **({} if about is None else {"Mcp-Name": about}),
    }
    return request("POST", path, body, headers)


def call(path: str, tool: str, **arguments: Any) -> bytes:
    """The bytes of a tool call."""
    return message(path, "tools/call", {"name": tool, "arguments": arguments}, tool)


def raw_call(path: str, arguments: str, tool: str = "get_position") -> bytes:
    """The bytes of a tool call with arbitrary JSON as its arguments."""
    head = json.dumps({"jsonrpc": "2.0", "id": next(_IDS), "method": "tools/call"})[:-1]
    params = f'"params": {{"name": {json.dumps(tool)}, "arguments": {arguments}, "_meta": {json.dumps(_META)}}}'
    return posted(path, f"{head}, {params}}}".encode(), "tools/call", tool)


async def opened(port: int, scene: int = 7, max_calls: int | None = None) -> dict[str, str]:
    """Open an episode; returns the host's description of it, and its `path`."""
    wanted = {"scene": scene} | ({} if max_calls is None else {"max_calls": max_calls})
    connection = await Connection.dial(port)
    try:
        reply = await connection.ask(request("POST", "/episodes", json.dumps(wanted).encode()))
    finally:
        connection.close()
    if reply.status != 201:
        raise ConnectionRefusedError(f"no episode was opened: {reply.body.decode()}")
    episode: dict[str, str] = json.loads(reply.body)
    return {**episode, "path": f"/episodes/{episode['episode_id']}/mcp"}
