"""From what `--server` says to connected MCP clients, one session for each episode."""

import contextlib
import functools
import json
import os
import secrets
import shlex
import ssl
import subprocess
import sys
import tempfile
from collections.abc import AsyncGenerator, Mapping
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, Protocol, cast

import anyio
import httpx2
from mcp import Client, StdioServerParameters
from mcp.client.stdio import stdio_client
from mcp.client.streamable_http import streamable_http_client

from evaluator.episode.toolbox import Toolboxes
from evaluator.errors import EvaluatorError, InfrastructureError, PermanentFailure, UsageError

_CALL_TIMEOUT_S = 300.0
"""A call that takes longer counts as a failure of the server."""
_START_TIMEOUT_S = 60.0


TOKEN_VARIABLE = "PHYSMENT_HOST_TOKEN"  # noqa: S105 - a name, not a token
"""Environment variable with the token that a host wants of whoever opens episodes on it."""


class Laboratory(Protocol):
    """Where sessions are opened."""

    @property
    def toolboxes(self) -> Toolboxes | None:
        """What knows the tools of its server; None if each session has a server of its own."""
        ...

    def open(self, scene: int, seed: int) -> AbstractAsyncContextManager[Client]:
        """A connected client of a fresh episode; closing it ends the episode.

        Raises:
            InfrastructureError: The server cannot be reached or died.
        """
        ...


@dataclass(frozen=True, slots=True)
class ProcessLaboratory:
    """Starts a server process on stdio for each episode.

    `command` may hold `{scene}` and `{seed}`; without them `--scene N --seed S` is appended.
    """

    command: tuple[str, ...]

    @property
    def toolboxes(self) -> None:
        """None: each session has a server of its own."""

    @contextlib.asynccontextmanager
    async def open(self, scene: int, seed: int) -> AsyncGenerator[Client]:
        """Start the command and connect to it."""
        line = [part.replace("{scene}", str(scene)).replace("{seed}", str(seed)) for part in self.command]
        if line == list(self.command):
            line += ["--scene", str(scene), "--seed", str(seed)]
        with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as errors:
            transport = stdio_client(StdioServerParameters(command=line[0], args=line[1:]), errlog=errors)
            try:
                async with Client(transport, read_timeout_seconds=_CALL_TIMEOUT_S, cache=None) as client:
                    yield client
            except Exception as error:
                # Where a call did not return, the last words of the server tell more than we know.
                raise _ours(error, PermanentFailure, UsageError) or _failed(
                    f"the server command {shlex.join(line)!r} failed", error, errors
                ) from error


@dataclass(frozen=True, slots=True)
class HostLaboratory:
    """Opens episodes on a host over HTTP."""

    base_url: str
    token: str | None = field(default=None, repr=False)
    """What opens episodes on it; None if anybody may."""
    toolboxes: Toolboxes = field(default_factory=Toolboxes, repr=False, compare=False)

    @contextlib.asynccontextmanager
    async def open(self, scene: int, seed: int) -> AsyncGenerator[Client]:
        """Open an episode, connect to it, and close it afterwards."""
        async with http_client(self.base_url) as http:
            opened = await self.request_episode(http, {"scene": scene, "seed": seed})
            try:
                http.headers.update(self._bearing(opened["mcp_url"]))
                async with mcp_client(opened["mcp_url"], http) as client:
                    yield client
            except Exception as error:
                failure = InfrastructureError(f"the host {self.base_url} failed: {_root(error)!r}")
                raise _ours(error, EvaluatorError) or failure from error
            finally:
                with anyio.CancelScope(shield=True), contextlib.suppress(httpx2.HTTPError):
                    await http.delete(f"/episodes/{opened['episode_id']}", headers=self._bearing(self.base_url))

    async def request_episode(self, http: httpx2.AsyncClient, wanted: Mapping[str, int]) -> dict[str, str]:
        """Ask for an episode.

        Args:
            http: A client whose base is the address of this host.
            wanted: Body of the request.

        Returns:
            What the host says of the episode: at least its id and its MCP address.

        Raises:
            InfrastructureError: The host cannot be reached, or opened none.
        """
        try:
            reply = await http.post(
                "/episodes", json=wanted, headers=self._bearing(self.base_url), timeout=_START_TIMEOUT_S
            )
        except httpx2.HTTPError as error:
            raise InfrastructureError(f"the host {self.base_url} cannot be reached: {error!r}") from error
        said: Any = {}
        with contextlib.suppress(ValueError):
            said = reply.json()
        if isinstance(said, dict):
            if not reply.is_success and "error" in said:
                hint = f" ({TOKEN_VARIABLE} is where we look for it)" if reply.status_code == 401 else ""
                raise InfrastructureError(f"the host {self.base_url} opened no episode: {said['error']}{hint}")
            if reply.is_success and {"episode_id", "mcp_url"} <= said.keys():
                return cast(dict[str, str], said)
        raise InfrastructureError(
            f"{self.base_url} is no PhysMent host: it answered {reply.status_code} to POST /episodes"
        )

    def _bearing(self, url: str) -> dict[str, str]:
        """The headers that bear the token, for a URL of this host; no other host is to see it."""
        own, other = httpx2.URL(self.base_url), httpx2.URL(url)
        ours = (own.scheme, own.host, own.port) == (other.scheme, other.host, other.port)
        return {"Authorization": f"Bearer {self.token}"} if self.token is not None and ours else {}


def http_client(base_url: str) -> httpx2.AsyncClient:
    """A client for one episode: asks for it, carries its calls and closes it, all over one connection.

    Args:
        base_url: Address of the host.
    """
    patience = httpx2.Timeout(_START_TIMEOUT_S, read=_CALL_TIMEOUT_S)
    return httpx2.AsyncClient(base_url=base_url, verify=_trust(), timeout=patience)


@contextlib.asynccontextmanager
async def mcp_client(url: str, http: httpx2.AsyncClient) -> AsyncGenerator[Client]:
    """A client connected to the MCP endpoint of an episode. It keeps no cache: nothing is asked twice."""
    transport = streamable_http_client(url, http_client=http)
    async with Client(transport, read_timeout_seconds=_CALL_TIMEOUT_S, cache=None) as client:
        yield client


@functools.cache
def _trust() -> ssl.SSLContext:
    """The authorities that HTTP clients trust: read once, since reading them takes 20 ms of processor time."""
    return httpx2.create_ssl_context()


@dataclass(slots=True)
class LocalHost:
    """A warm host of our own, as a process that lives as long as the context."""

    scenes_dir: Path | None = None
    max_episodes: int = 1000
    token: str | None = field(default=None, repr=False)
    """What is to open episodes on it; None if anybody on this machine may."""
    _process: subprocess.Popen[str] | None = None
    _errors: IO[str] | None = field(default=None)

    async def __aenter__(self) -> HostLaboratory:
        """Start the host on a free port.

        Raises:
            UsageError: It does not start.
        """
        self._errors = tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace")  # noqa: SIM115 - closed below
        command = [
            sys.executable,
            "-m",
            "physment_mcp",
            "serve",
            "--port",
            "0",
            "--max-episodes",
            str(self.max_episodes),
            # Its stdin is a pipe of ours, which the system closes even if we are killed.
            "--end-with-stdin",
        ]
        command += ["--scenes-dir", str(self.scenes_dir)] if self.scenes_dir else []
        command += ["--token-env", TOKEN_VARIABLE] if self.token else []
        environment = os.environ | ({TOKEN_VARIABLE: self.token} if self.token else {})
        self._process = subprocess.Popen(  # noqa: ASYNC220, S603 - starts our own server, and does not wait
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._errors, text=True, env=environment
        )
        assert self._process.stdout is not None
        line = await anyio.to_thread.run_sync(self._process.stdout.readline)
        try:
            return HostLaboratory(json.loads(line)["listening"], self.token)
        except (ValueError, KeyError, TypeError):
            await self.__aexit__()
            raise UsageError("the local host did not start; run `physment-mcp serve` to see why") from None

    async def __aexit__(self, *_: object) -> None:
        """Stop the host."""
        assert self._process is not None
        assert self._errors is not None
        self._process.terminate()
        with anyio.CancelScope(shield=True):
            await anyio.to_thread.run_sync(self._process.wait)
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.close()
        self._process.stdout.close()
        self._errors.close()


@contextlib.asynccontextmanager
async def connect(server: str, scenes_dir: Path | None) -> AsyncGenerator[Laboratory]:
    """The laboratory that `--server` names.

    Args:
        server: `stdio` (a process for each episode), `host` (one warm local host), the URL of a host, or a command.
        scenes_dir: Folder of packs for servers we start ourselves.

    Raises:
        UsageError: `server` is none of these.
    """
    if server == "stdio":
        command = [sys.executable, "-m", "physment_mcp"]
        yield ProcessLaboratory((*command, "--scenes-dir", str(scenes_dir)) if scenes_dir else tuple(command))
    elif server == "host":
        # An agent that has the address of an episode must not open others, to practise in them unseen.
        async with LocalHost(scenes_dir, token=secrets.token_urlsafe(24)) as laboratory:
            yield laboratory
    elif server.startswith(("http://", "https://")):
        try:
            url = httpx2.URL(server.rstrip("/"))
        except httpx2.InvalidURL as error:
            raise UsageError(f"--server {server}: not a URL: {error}") from error
        if not url.host or (url.port or 0) > 65535:
            raise UsageError(f"--server {server}: not the URL of a host, such as http://127.0.0.1:8000")
        yield HostLaboratory(str(url), os.environ.get(TOKEN_VARIABLE) or None)
    else:
        try:
            parts = shlex.split(server)
        except ValueError as error:
            raise UsageError(f"--server {server!r} is not a command: {error}") from error
        if not parts:
            raise UsageError("--server is empty; use stdio, host, a URL or a command")
        yield ProcessLaboratory(tuple(parts))


def _failed(what: str, error: Exception, errors: IO[str]) -> InfrastructureError:
    """The sentence for a server process that failed, with its own last words."""
    errors.seek(0)
    said = [line.strip() for line in errors.read().splitlines() if line.strip()]
    return InfrastructureError(f"{what}: {said[-1] if said else repr(_root(error))}")


def _ours(error: Exception, *kinds: type[EvaluatorError]) -> EvaluatorError | None:
    """The error of one of these kinds that a client wrapped because it was connected; None if it is another."""
    root = _root(error)
    return root if isinstance(root, kinds) else None


def _root(error: BaseException) -> BaseException:
    """The first single error inside exception groups."""
    if isinstance(error, BaseExceptionGroup):
        parts = cast(BaseExceptionGroup[BaseException], error).exceptions
        return _root(parts[0])
    return error
