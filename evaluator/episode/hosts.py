"""Episode servers: clients of their episodes over HTTP, and a server that this process starts and that ends with it.

This process and a server that it started hold the two ends of a control socket. For each episode, this process creates
a socket pair and sends one end through the control socket. The first line on the new socket is the request for the
episode. After the server's reply, every line is an MCP message. Closing the socket closes the episode.
"""

import contextlib
import functools
import json
import socket
import ssl
import subprocess
import sys
import tempfile
from collections.abc import AsyncGenerator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, cast

import anyio
import httpx2
from mcp.client import Client, ClientExtension
from mcp.client._transport import Transport
from mcp.client.streamable_http import streamable_http_client

from evaluator.episode.connections import (
    AVAILABLE,
    ControlSocket,
    Messages,
    first_error,
    own_error,
    passed,
    reason,
    server_failure,
    without_seed,
)
from evaluator.episode.toolbox import Toolboxes
from evaluator.errors import EvaluatorError, InfrastructureError, ServerFull, UsageError
from evaluator.records.run import SeedOf, seed_as_recorded

CALL_TIMEOUT_S = 300.0
"""A call that takes longer counts as a failure of the server [s]."""
_START_TIMEOUT_S = 60.0
"""Longest wall time for opening an episode [s]."""
TEXT = "text"
"""The value of `--observations` for results without images."""
TOKEN_VARIABLE = "PHYSMENT_HOST_TOKEN"  # noqa: S105 - a name, not a token
"""Environment variable with the token that an episode server requires to open episodes."""


@dataclass(frozen=True, slots=True)
class HostConnector:
    """Opens episodes on an episode server: over HTTP, or over sockets if this process started the server."""

    base_url: str
    token: str | None = field(default=None, repr=False)
    """Token required to open episodes; None if the server requires none."""
    toolboxes: Toolboxes = field(default_factory=Toolboxes, repr=False, compare=False)
    control: ControlSocket | None = field(default=None, repr=False, compare=False)
    """Opens episodes without HTTP on a server that this process started; None for other servers."""
    seed_of: SeedOf = seed_as_recorded
    declared: Sequence[ClientExtension] = ()
    """MCP extensions that the clients declare."""

    @contextlib.asynccontextmanager
    async def open(self, scene: int, seed: int) -> AsyncGenerator[Client]:
        """Open an episode, connect to it, and close it afterwards."""
        wanted, drawn = {"scene": scene, "seed": seed}, self.seed_of(scene, seed)
        place = (
            self._over_http(wanted)
            if self.control is None
            else _over_socket(self.control, wanted | {"seed": drawn}, self.declared)
        )
        try:
            async with place as client:
                yield client
        except Exception as error:
            failure = InfrastructureError(f"the host {self.base_url} failed: {reason(first_error(error))}")
            raise without_seed(own_error(error, EvaluatorError) or failure, drawn, seed) from error

    @contextlib.asynccontextmanager
    async def _over_http(self, wanted: Mapping[str, int]) -> AsyncGenerator[Client]:
        async with http_client(self.base_url) as http:
            opened = await self.request_episode(http, wanted)
            try:
                http.headers.update(self._authorization(opened["mcp_url"]))
                async with mcp_client(opened["mcp_url"], http, self.declared) as client:
                    yield client
            finally:
                with anyio.CancelScope(shield=True), contextlib.suppress(httpx2.HTTPError):
                    await http.delete(f"/episodes/{opened['episode_id']}", headers=self._authorization(self.base_url))

    async def request_episode(self, http: httpx2.AsyncClient, wanted: Mapping[str, int]) -> dict[str, str]:
        """Request a new episode.

        Args:
            http: A client whose base URL is the address of this server.
            wanted: Request body, with the seed as recorded.

        Returns:
            The server's reply, with at least the id and the MCP address of the episode.

        Raises:
            InfrastructureError: The server cannot be reached, or opened no episode; `ServerFull` if it is full.
        """
        drawn = self.seed_of(wanted["scene"], wanted["seed"])
        try:
            reply = await http.post(
                "/episodes",
                json={**wanted, "seed": drawn},
                headers=self._authorization(self.base_url),
                timeout=_START_TIMEOUT_S,
            )
        except httpx2.HTTPError as error:
            raise InfrastructureError(f"the host {self.base_url} cannot be reached: {reason(error)}") from error
        body: Any = {}
        with contextlib.suppress(ValueError):
            body = reply.json()
        if isinstance(body, dict):
            if not reply.is_success and "error" in body:
                hint = f" ({TOKEN_VARIABLE} is where we look for it)" if reply.status_code == 401 else ""
                kind = ServerFull if reply.status_code == 429 else InfrastructureError
                failure = kind(f"the host {self.base_url} opened no episode: {body['error']}{hint}")
                raise without_seed(failure, drawn, wanted["seed"])
            if reply.is_success and {"episode_id", "mcp_url"} <= body.keys():
                return cast(dict[str, str], body)
        raise InfrastructureError(
            f"{self.base_url} is no PhysMent host: it answered {reply.status_code} to POST /episodes"
        )

    def _authorization(self, url: str) -> dict[str, str]:
        """Return the authorization header for a URL of this server; no header for any other server."""
        own, other = httpx2.URL(self.base_url), httpx2.URL(url)
        ours = (own.scheme, own.host, own.port) == (other.scheme, other.host, other.port)
        return {"Authorization": f"Bearer {self.token}"} if self.token is not None and ours else {}


@contextlib.asynccontextmanager
async def _over_socket(
    control: ControlSocket, wanted: Mapping[str, int], declared: Sequence[ClientExtension]
) -> AsyncGenerator[Client]:
    """Open an episode through the control socket of a server and return its client; it is closed afterwards.

    Args:
        control: Control socket of the server.
        wanted: Request body of `POST /episodes`.
        declared: MCP extensions that the client declares.

    Raises:
        InfrastructureError: The server is gone, or did not open the episode.
    """
    async with contextlib.AsyncExitStack() as stack:
        try:
            messages = await stack.enter_async_context(passed(control))
        except OSError as error:
            raise InfrastructureError(f"the local host cannot be reached: {error.strerror or error}") from error
        await _request(messages, wanted)
        yield await stack.enter_async_context(messages.client(CALL_TIMEOUT_S, declared))


async def _request(messages: Messages, wanted: Mapping[str, int]) -> None:
    """Request an episode.

    Raises:
        InfrastructureError: The server did not open it.
    """
    reply: Any = None
    with anyio.move_on_after(_START_TIMEOUT_S), contextlib.suppress(OSError, ValueError):
        messages.write(wanted)
        reply = json.loads(await messages.reader.readline())
    match reply:
        case {"opened": True}:
            return
        case {"error": str(sentence)}:
            raise InfrastructureError(f"the local host opened no episode: {sentence}")
        case _:
            raise InfrastructureError(
                "the local host cannot be reached: it did not reply to the request for an episode"
            )


def http_client(base_url: str) -> httpx2.AsyncClient:
    """Create an HTTP client for one episode, which is opened, played and closed over one connection.

    Args:
        base_url: Address of the episode server.
    """
    patience = httpx2.Timeout(_START_TIMEOUT_S, read=CALL_TIMEOUT_S)
    return httpx2.AsyncClient(base_url=base_url, verify=_trust(), timeout=patience)


@contextlib.asynccontextmanager
async def mcp_client(
    url: str, http: httpx2.AsyncClient, declared: Sequence[ClientExtension] = ()
) -> AsyncGenerator[Client]:
    """Connect a client to the MCP endpoint of an episode."""
    async with client_of(streamable_http_client(url, http_client=http), declared) as client:
        yield client


def client_of(transport: Transport, declared: Sequence[ClientExtension]) -> Client:
    """Create a client without a response cache, because no request is repeated."""
    return Client(transport, read_timeout_seconds=CALL_TIMEOUT_S, cache=None, extensions=declared)


@functools.cache
def _trust() -> ssl.SSLContext:
    """Load the trusted certificate authorities. Cached, because loading them takes 20 ms."""
    return httpx2.create_ssl_context()


@dataclass(slots=True)
class LocalHost:
    """An episode server in a child process, which runs as long as the context is open."""

    scenes_dir: Path | None = None
    max_episodes: int = 100_000
    """Limit on open episodes. Only this evaluator opens episodes, so its own concurrency is the effective limit."""
    token: str | None = field(default=None, repr=False)
    """Token required to open episodes; None if any program on this machine may open them."""
    observations: str = TEXT
    """`text`, or `rgb` for results with images."""
    _process: subprocess.Popen[str] | None = None
    _control: ControlSocket | None = None
    _errors: IO[str] | None = field(default=None)

    async def __aenter__(self) -> HostConnector:
        """Start the server on a free port.

        Raises:
            UsageError: The server does not start.
        """
        try:
            process = self._start()
        except OSError as error:
            self._let_go()
            raise UsageError(f"the local host did not start: {error.strerror}") from error
        assert process.stdout is not None
        line = await anyio.to_thread.run_sync(process.stdout.readline)
        try:
            address: str = json.loads(line)["listening"]
        except (ValueError, KeyError, TypeError):
            process.terminate()
            await anyio.to_thread.run_sync(process.wait)
            assert self._errors is not None
            failure = server_failure("the local host did not start", RuntimeError("it ended at once"), self._errors)
            await self.__aexit__()
            raise UsageError(str(failure)) from None
        return HostConnector(address, self.token, Toolboxes(trusted=True), self._control)

    def _start(self) -> subprocess.Popen[str]:
        """Start the process on a free port, with a control socket if the system can pass sockets between processes.

        Its stdin is a pipe that the operating system closes even if this process is killed, which ends the server. It
        prints its address as the first line.

        Raises:
            OSError: The operating system cannot create another process or file.
        """
        self._errors = tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace")  # noqa: SIM115 - closed below
        command = [sys.executable, "-m", "physment_mcp", "serve", "--port", "0", "--end-with-stdin"]
        command += ["--max-episodes", str(self.max_episodes)]
        command += ["--scenes-dir", str(self.scenes_dir)] if self.scenes_dir else []
        command += ["--observations", self.observations] if self.observations != TEXT else []
        command += ["--token-stdin"] if self.token else []
        with contextlib.ExitStack() as stack:
            inherited: list[int] = []
            if AVAILABLE:
                ours, theirs = socket.socketpair()
                self._control = ControlSocket(ours)
                ours.setblocking(False)
                inherited.append(stack.enter_context(theirs).fileno())
                command += ["--control-fd", str(theirs.fileno())]
            self._process = process = subprocess.Popen(  # noqa: S603 - our own server
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._errors,
                text=True,
                pass_fds=inherited,
            )
        assert process.stdin is not None
        if self.token:
            # Not in an environment variable, which other programs of this user could read.
            with contextlib.suppress(BrokenPipeError):  # the process has exited; its last output line is reported
                process.stdin.write(f"{self.token}\n")
                process.stdin.flush()
        return process

    async def __aexit__(self, *_: object) -> None:
        """Stop the server."""
        assert self._process is not None
        self._process.terminate()
        with anyio.CancelScope(shield=True):
            await anyio.to_thread.run_sync(self._process.wait)
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.close()
        self._process.stdout.close()
        self._let_go()

    def _let_go(self) -> None:
        if self._errors is not None:
            self._errors.close()
        if self._control is not None:
            self._control.close()
