"""Sessions on stdio in processes forked from one process that has already loaded the engine.

Each episode has its own process, with its own stdin, stdout and stderr. A fork takes a fiftieth of the processor time
that a new process takes. POSIX only.
"""

import contextlib
import os
import socket
import subprocess
import sys
import tempfile
from collections.abc import AsyncGenerator, Sequence
from dataclasses import dataclass, field
from typing import IO, Self

from mcp import Client
from mcp.client.extension import ClientExtension

from evaluator.episode.broken_connection import own_error, server_failure, without_seed
from evaluator.episode.passed_sockets import ControlSocket, passed
from evaluator.errors import PermanentFailure, UsageError
from evaluator.records.seed_key import SeedOf, seed_as_recorded

_END_S = 10.0
"""Longest wall time for the fork server and its forks to exit [s]."""


@dataclass(slots=True)
class ForkedConnector:
    """Forks a server process on stdio for each episode, as long as the context is open."""

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
