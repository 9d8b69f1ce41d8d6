"""Turns the value of `--server` into connected MCP clients, with one session per episode."""

import contextlib
import os
import re
import secrets
import shlex
import socket
import subprocess
import sys
import tempfile
from collections.abc import AsyncGenerator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import IO, Protocol, Self

import httpx2
from mcp import Client, StdioServerParameters, stdio_client
from mcp.client import ClientExtension

from evaluator.episode.connections import AVAILABLE, ControlSocket, own_error, passed, server_failure, without_seed
from evaluator.episode.hosts import CALL_TIMEOUT_S, TEXT, TOKEN_VARIABLE, HostConnector, LocalHost, client_of
from evaluator.episode.toolbox import Toolboxes
from evaluator.errors import PermanentFailure, UsageError
from evaluator.records.run import SeedOf, seed_as_recorded

_END_S = 10.0
"""Longest wall time for the fork server and its forks to exit [s]."""


@dataclass(slots=True)
class ForkedConnector:
    """Forks a server process on stdio for each episode, as long as the context is open. POSIX only.

    The forks come from one process that has loaded the engine. A fork takes a fiftieth of the processor time of a new
    process.
    """

    words: tuple[str, ...]
    """`physment-mcp` options of every episode."""
    timeout_s: float
    """Longest wall time of a call [s]."""
    seed_of: SeedOf = seed_as_recorded
    declared: Sequence[ClientExtension] = ()
    """MCP extensions that the clients declare."""
    _process: subprocess.Popen[bytes] | None = field(default=None, repr=False)
    _control: ControlSocket | None = field(default=None, repr=False)
    _told: IO[str] | None = field(default=None, repr=False)
    """Captured stderr of the fork server; empty unless it fails to load."""

    @property
    def toolboxes(self) -> None:
        """None: each session has its own server."""

    def __enter__(self) -> Self:
        """Start the fork server now, so that it loads while the run is prepared."""
        with contextlib.suppress(OSError):  # `open` tries again and reports the error
            self._running()
        return self

    def __exit__(self, *_: object) -> None:
        """Stop the fork server, which ends every fork that is still running."""
        self._let_go()

    @contextlib.asynccontextmanager
    async def open(self, scene: int, seed: int) -> AsyncGenerator[Client]:
        """Fork a server process and connect to it."""
        drawn = self.seed_of(scene, seed)
        with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as errors:
            try:
                async with passed(self._running(), errors.fileno()) as messages:
                    messages.write([*self.words, "--scene", str(scene), "--seed", str(drawn)])
                    async with messages.client(self.timeout_s, self.declared) as client:
                        yield client
            except Exception as error:
                # The last line of the forked process is more specific than the client's exception. If there is none,
                # use that of the fork server.
                wrote = errors if errors.seek(0, os.SEEK_END) else self._told or errors
                failure = server_failure(f"the server process of scene {scene} failed", error, wrote)
                found = own_error(error, PermanentFailure, UsageError) or failure
                raise without_seed(found, drawn, seed) from error

    def _running(self) -> ControlSocket:
        """Return the control socket of the fork server. If it has died, start a new one; running forks are unaffected.

        Raises:
            OSError: The operating system cannot create another process or file.
        """
        if self._control is not None and self._process is not None and self._process.poll() is None:
            return self._control
        self._let_go()
        self._told = tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace")  # noqa: SIM115 - see _let_go
        ours, theirs = socket.socketpair()
        with theirs:
            ours.setblocking(False)
            try:
                self._process = subprocess.Popen(  # noqa: S603 - our own server
                    [sys.executable, "-m", "physment_mcp", "fork-server", "--control-fd", str(theirs.fileno())],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=self._told,
                    pass_fds=[theirs.fileno()],
                    # A process must have a single thread to fork safely.
                    env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
                    start_new_session=True,  # Ctrl-C must reach only this process, which stops the fork server itself
                )
            except BaseException:
                ours.close()
                raise
        self._control = ControlSocket(ours)
        return self._control

    def _let_go(self) -> None:
        if self._control is not None:
            self._control.close()
            self._control = None
        if self._process is not None:
            try:
                self._process.wait(_END_S)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
            self._process = None
        if self._told is not None:
            self._told.close()
            self._told = None


class EpisodeConnector(Protocol):
    """Opens sessions on a laboratory server."""

    @property
    def toolboxes(self) -> Toolboxes | None:
        """Cached tools of the server; None if each session has its own server."""
        ...

    def open(self, scene: int, seed: int) -> contextlib.AbstractAsyncContextManager[Client]:
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
                async with client_of(transport, self.declared) as client:
                    yield client
            except Exception as error:
                # The last line that the server wrote is more specific than the client's exception.
                failure = server_failure(f"the server command {shlex.join(line)!r} failed", error, errors)
                found = own_error(error, PermanentFailure, UsageError) or failure
                raise without_seed(found, drawn, seed) from error


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
            with ForkedConnector(tuple(words), CALL_TIMEOUT_S, seed_of, declared) as laboratory:
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
