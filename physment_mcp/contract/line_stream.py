"""Adapts a socket to the pair of streams of an MCP session: each message is one line of JSON."""

import asyncio
import json
from dataclasses import dataclass
from types import TracebackType
from typing import Self

import anyio
import mcp_types as types
from mcp.shared.message import SessionMessage


@dataclass(slots=True, eq=False)
class LineStream:
    """Stream of MCP messages over a socket. Whoever created the socket must close it."""

    reader: asyncio.StreamReader
    writer: asyncio.StreamWriter

    async def receive(self) -> SessionMessage | Exception:
        """Receive the next message, or the exception raised by parsing its line.

        Raises:
            anyio.EndOfStream: The other end closed the connection or sent a line that is too long.
        """
        try:
            line = await self.reader.readline()
        except ValueError:
            self.too_long()
            raise anyio.EndOfStream from None
        except OSError:
            raise anyio.EndOfStream from None
        if not line.endswith(b"\n"):
            raise anyio.EndOfStream
        try:
            return SessionMessage(types.jsonrpc_message_adapter.validate_json(line, by_name=False))
        except ValueError as error:
            return error

    def too_long(self) -> None:
        """Hook that is called when a line exceeds the limit of the reader."""

    async def send(self, item: SessionMessage, /) -> None:
        """Send a message; waits while the other end does not read (backpressure)."""
        written = item.message.model_dump_json(by_alias=True, exclude_unset=True)
        try:
            self.writer.write(written.encode() + b"\n")
            await self.writer.drain()
        except OSError as error:
            raise anyio.BrokenResourceError from error

    def write(self, line: object) -> None:
        """Write a line of JSON that is not an MCP message."""
        self.writer.write(json.dumps(line).encode() + b"\n")

    async def aclose(self) -> None:
        """Do nothing: the creator of the socket closes both directions when the episode ends."""

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> SessionMessage | Exception:
        try:
            return await self.receive()
        except anyio.EndOfStream:
            raise StopAsyncIteration from None

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, exc_type: type[BaseException] | None, exc_val: BaseException | None, exc_tb: TracebackType | None
    ) -> None:
        await self.aclose()
