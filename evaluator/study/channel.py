"""Objects that the processes of one run send each other."""

import asyncio
import contextlib
import pickle
import socket
from dataclasses import dataclass
from typing import Any, Self

_LENGTH = 8
"""Bytes before each message, which hold its length."""


@dataclass(slots=True)
class ProcessChannel:
    """Objects over a socket between two processes of one run, which trust each other."""

    reader: asyncio.StreamReader
    writer: asyncio.StreamWriter
    closed: bool = False
    """Whether the other end is gone."""

    @classmethod
    async def over(cls, connection: socket.socket) -> Self:
        """A channel over a connected socket."""
        return cls(*await asyncio.open_connection(sock=connection))

    async def receive(self) -> Any:
        """The next object; None if the other end is gone."""
        try:
            length = int.from_bytes(await self.reader.readexactly(_LENGTH))
            return pickle.loads(await self.reader.readexactly(length))  # noqa: S301 - from our own process
        except (asyncio.IncompleteReadError, OSError):
            self.closed = True
            return None

    def send(self, message: object) -> None:
        """Send an object. Nothing is sent if the other end is gone."""
        written = pickle.dumps(message)
        with contextlib.suppress(OSError):
            self.writer.write(len(written).to_bytes(_LENGTH) + written)

    def close(self) -> None:
        """Tell the other end that this one is gone."""
        self.closed = True
        self.writer.close()


@dataclass(frozen=True, slots=True)
class Crash:
    """An error that nobody expected."""

    trace: str
