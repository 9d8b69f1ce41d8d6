"""Starts an episode server as a child process that ends when this process ends, for whatever reason."""

import contextlib
import socket
import subprocess
import sys
from collections.abc import Sequence
from typing import IO

from evaluator.episode.passed_sockets import AVAILABLE, ControlSocket


def start_host(
    options: Sequence[str], token: str | None, errors: IO[str]
) -> tuple[subprocess.Popen[str], ControlSocket | None]:
    """Start an episode server on a free port. It prints its address as the first line.

    Args:
        options: Options of `physment-mcp serve`.
        token: Token required to open episodes over HTTP; None if any program on this machine may open them.
        errors: File that captures its stderr.

    Returns:
        The process, whose stdin is a pipe that the operating system closes even if this process is killed; and the
        control socket that opens episodes on it, None if the system cannot pass sockets between processes.

    Raises:
        OSError: The operating system cannot create another process or file.
    """
    command = [sys.executable, "-m", "physment_mcp", "serve", "--port", "0", "--end-with-stdin", *options]
    if not AVAILABLE:
        return _started(command, (), token, errors), None
    ours, theirs = socket.socketpair()
    try:
        ours.setblocking(False)
        with theirs:
            command += ["--control-fd", str(theirs.fileno())]
            return _started(command, [theirs.fileno()], token, errors), ControlSocket(ours)
    except BaseException:
        ours.close()
        raise


def _started(
    command: Sequence[str], inherited: Sequence[int], token: str | None, errors: IO[str]
) -> subprocess.Popen[str]:
    process = subprocess.Popen(  # noqa: S603 - our own server
        [*command, *(["--token-stdin"] if token else [])],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=errors,
        text=True,
        pass_fds=inherited,
    )
    assert process.stdin is not None
    if token:
        # Not in an environment variable, which other programs of this user could read.
        with contextlib.suppress(BrokenPipeError):  # the process has exited; its last output line is reported
            process.stdin.write(f"{token}\n")
            process.stdin.flush()
    return process
