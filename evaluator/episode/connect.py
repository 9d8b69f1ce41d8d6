"""Turns the value of `--server` into connected MCP clients, with one session per episode."""

import contextlib
import functools
import json
import os
import re
import secrets
import shlex
import ssl
import subprocess
import sys
import tempfile
from collections.abc import AsyncGenerator, Mapping, Sequence
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Any, Protocol, cast

import anyio
import httpx2
from mcp import Client, StdioServerParameters
from mcp.client._transport import Transport
from mcp.client.extension import ClientExtension
from mcp.client.stdio import stdio_client
from mcp.client.streamable_http import streamable_http_client

from evaluator.episode.broken_connection import first_error, own_error, reason, server_failure, without_seed
from evaluator.episode.forked_processes import ForkedConnector
from evaluator.episode.local_host import HostSockets, start_host
from evaluator.episode.passed_sockets import AVAILABLE, ControlSocket
from evaluator.episode.toolbox import Toolboxes
from evaluator.errors import EvaluatorError, InfrastructureError, PermanentFailure, ServerFull, UsageError
from evaluator.records.run import SeedOf, seed_as_recorded

_CALL_TIMEOUT_S = 300.0
"""A call that takes longer counts as a failure of the server [s]."""
_START_TIMEOUT_S = 60.0

TEXT = "text"
"""The value of `--observations` for results without images."""
TOKEN_VARIABLE = "PHYSMENT_HOST_TOKEN"  # noqa: S105 - a name, not a token
"""Environment variable with the token that an episode server requires to open episodes."""


class EpisodeConnector(Protocol):
    """Opens sessions on a laboratory server."""

    @property
    def toolboxes(self) -> Toolboxes | None:
        """Cached tools of the server; None if each session has a server of its own."""
        ...

    def open(self, scene: int, seed: int) -> AbstractAsyncContextManager[Client]:
        """Return a connected client of a new episode; closing it ends the episode.

        Raises:
            InfrastructureError: The server cannot be reached or died.
        """
        ...


@dataclass(frozen=True, slots=True)
class ProcessConnector:
    """Starts a server process on stdio for each episode.

    `command` may hold `{scene}` and `{seed}`; without them `--scene N --seed S` is appended.
    """

    command: tuple[str, ...]
    seed_of: SeedOf = seed_as_recorded
    declared: Sequence[ClientExtension] = ()
    """MCP extensions that the clients declare."""

    @property
    def toolboxes(self) -> None:
        """None: each session has its own server."""

    @contextlib.asynccontextmanager
    async def open(self, scene: int, seed: int) -> AsyncGenerator[Client]:
        """Start the command and connect to it."""
        drawn = self.seed_of(scene, seed)
        line = [part.replace("{scene}", str(scene)).replace("{seed}", str(drawn)) for part in self.command]
        if line == list(self.command):
            line += ["--scene", str(scene), "--seed", str(drawn)]
        with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as errors:
            transport = stdio_client(StdioServerParameters(command=line[0], args=line[1:]), errlog=errors)
            try:
                async with _client(transport, self.declared) as client:
                    yield client
            except Exception as error:
                # The last line that the server wrote is more specific than the client's exception.
                failure = server_failure(f"the server command {shlex.join(line)!r} failed", error, errors)
                found = own_error(error, PermanentFailure, UsageError) or failure
                raise without_seed(found, drawn, seed) from error


@dataclass(frozen=True, slots=True)
class HostConnector:
    """Opens episodes on an episode server: over HTTP, or over sockets if this process started the server."""

    base_url: str
    token: str | None = field(default=None, repr=False)
    """Token required to open episodes; None if the server requires none."""
    toolboxes: Toolboxes = field(default_factory=Toolboxes, repr=False, compare=False)
    sockets: HostSockets | None = field(default=None, repr=False, compare=False)
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
            if self.sockets is None
            else self.sockets.episode(wanted | {"seed": drawn}, _CALL_TIMEOUT_S, self.declared)
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
            InfrastructureError: The server cannot be reached, or opened no episode; `ServerFull` if it has no place.
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


def http_client(base_url: str) -> httpx2.AsyncClient:
    """Create an HTTP client for one episode, which is opened, played and closed over one connection.

    Args:
        base_url: Address of the episode server.
    """
    patience = httpx2.Timeout(_START_TIMEOUT_S, read=_CALL_TIMEOUT_S)
    return httpx2.AsyncClient(base_url=base_url, verify=_trust(), timeout=patience)


@contextlib.asynccontextmanager
async def mcp_client(
    url: str, http: httpx2.AsyncClient, declared: Sequence[ClientExtension] = ()
) -> AsyncGenerator[Client]:
    """Connect a client to the MCP endpoint of an episode."""
    async with _client(streamable_http_client(url, http_client=http), declared) as client:
        yield client


def _client(transport: Transport, declared: Sequence[ClientExtension]) -> Client:
    """Create a client without a response cache, because no request is repeated."""
    return Client(transport, read_timeout_seconds=_CALL_TIMEOUT_S, cache=None, extensions=declared)


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
        sockets = HostSockets(self._control) if self._control else None
        return HostConnector(address, self.token, Toolboxes(trusted=True), sockets)

    def _start(self) -> subprocess.Popen[str]:
        """Start the process, which prints the address that it listens on.

        Raises:
            OSError: The operating system cannot create another process or file.
        """
        self._errors = tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace")  # noqa: SIM115 - closed below
        options = ["--max-episodes", str(self.max_episodes)]
        options += ["--scenes-dir", str(self.scenes_dir)] if self.scenes_dir else []
        options += ["--observations", self.observations] if self.observations != TEXT else []
        self._process, self._control = start_host(options, self.token, self._errors)
        return self._process

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


@contextlib.asynccontextmanager
async def connect(
    server: str,
    scenes_dir: Path | None,
    observations: str = TEXT,
    seed_of: SeedOf = seed_as_recorded,
    declared: Sequence[ClientExtension] = (),
) -> AsyncGenerator[EpisodeConnector]:
    """Open the laboratory that `--server` names.

    Args:
        server: `stdio` (a process per episode), `host` (one local episode server), the URL of one, or a command.
        scenes_dir: Folder of packs, for servers that this process starts.
        observations: `text`, or `rgb` for results with images, for servers that this process starts.
        seed_of: Maps recorded seeds to the seeds from which variants are sampled.
        declared: MCP extensions that the clients declare, such as `toolbox.shows_views`.

    Raises:
        UsageError: `server` has none of these forms, or images are requested from a server that is already running.
    """
    if observations != TEXT and server not in {"stdio", "host"}:
        raise UsageError(
            f"--observations {observations} is for servers that we start (--server stdio, --server host); start"
            f" {server} with --observations {observations} itself: its pictures are kept without this option"
        )
    if server == "stdio":
        words = ["--scenes-dir", str(scenes_dir)] if scenes_dir else []
        words += ["--observations", observations] if observations != TEXT else []
        if AVAILABLE:
            with ForkedConnector(tuple(words), _CALL_TIMEOUT_S, seed_of, declared) as laboratory:
                yield laboratory
        else:
            yield ProcessConnector((sys.executable, "-m", "physment_mcp", *words), seed_of, declared)
    elif server == "host":
        # The token keeps an agent that knows its address from opening other episodes, where it could practise.
        async with LocalHost(scenes_dir, token=secrets.token_urlsafe(24), observations=observations) as laboratory:
            yield replace(laboratory, seed_of=seed_of, declared=declared)
    elif re.match(r"[A-Za-z][A-Za-z0-9+.-]*://", server):
        try:
            url = httpx2.URL(server.rstrip("/"))
        except httpx2.InvalidURL as error:
            raise UsageError(f"--server {server}: not a URL: {error}") from error
        if url.scheme not in {"http", "https"} or not url.host or (url.port or 0) > 65535:
            raise UsageError(f"--server {server}: not the URL of a host, such as http://127.0.0.1:8000")
        yield HostConnector(str(url), os.environ.get(TOKEN_VARIABLE) or None, seed_of=seed_of, declared=declared)
    else:
        try:
            parts = shlex.split(server)
        except ValueError as error:
            raise UsageError(f"--server {server!r} is not a command: {error}") from error
        if not parts:
            raise UsageError("--server is empty; use stdio, host, a URL or a command")
        yield ProcessConnector(tuple(parts), seed_of, declared)
