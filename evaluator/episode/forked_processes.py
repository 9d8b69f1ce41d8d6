"""Sessions on stdio in processes that are forked from one of ours, which has loaded the engine once.

As with a command, each episode has a process of its own, with its own stdin, stdout and stderr. Starting one takes a
fiftieth of the processor time. POSIX only.
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
"""Longest wall time for the process and its forks to end [s]."""


@dataclass(slots=True)
class ForkedConnector:
    """Forks a server process on stdio for each episode, as long as the context is open."""

    words: tuple[str, ...]
    """Options of `physment-mcp` for every episode."""
    timeout_s: float
    """Longest wall time of a call [s]."""
    seed_of: SeedOf = seed_as_recorded
    declared: Sequence[ClientExtension] = ()
    """Extensions of MCP that clients declare."""
    _process: subprocess.Popen[bytes] | None = field(default=None, repr=False)
    _control: ControlSocket | None = field(default=None, repr=False)
    _told: IO[str] | None = field(default=None, repr=False)
    """What the process that forks wrote to stderr, which is nothing unless it cannot load."""

    @property
    def toolboxes(self) -> None:
        """None: each session has its own server."""

    def __enter__(self) -> Self:
        """Start the process that forks, so that it loads while the run is prepared."""
        with contextlib.suppress(OSError):  # `open` tries again and says why
            self._running()
        return self

    def __exit__(self, *_: object) -> None:
        """End it, and every fork that has not ended yet."""
        self._let_go()

    @contextlib.asynccontextmanager
    async def open(self, scene: int, seed: int) -> AsyncGenerator[Client]:
        """Fork a process and connect to it."""
        drawn = self.seed_of(scene, seed)
        with tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as errors:
            try:
                async with passed(self._running(), errors.fileno()) as messages:
                    messages.write([*self.words, "--scene", str(scene), "--seed", str(drawn)])
                    async with messages.client(self.timeout_s, self.declared) as client:
                        yield client
            except Exception as error:
                # The last line that the server wrote says more than the client knows, or that of the process that
                # should have forked it.
                wrote = errors if errors.seek(0, os.SEEK_END) else self._told or errors
                failure = server_failure(f"the server process of scene {scene} failed", error, wrote)
                found = own_error(error, PermanentFailure, UsageError) or failure
                raise without_seed(found, drawn, seed) from error

    def _running(self) -> ControlSocket:
        """The control socket of the process that forks. If it has died, another one is started; its forks live on.

        Raises:
            OSError: The system has no process or no file left.
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
                    # Forking is for processes of one thread.
                    env=os.environ | {"OPENBLAS_NUM_THREADS": "1"},
                    start_new_session=True,  # Ctrl-C is for us; we end it
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
