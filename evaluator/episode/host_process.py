"""Starting a host process of our own, which ends with this process however that ends."""

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
    """Start a host on a free port, whose address it prints as its first line.

    Args:
        options: Options of `physment-mcp serve`.
        token: Required to open episodes over HTTP; None if anybody on this machine may open them.
        errors: Where it writes what goes wrong.

    Returns:
        The process, whose stdin is our pipe: the operating system closes it even if this process is killed. And the
        control socket that opens episodes on it; None if the system passes no sockets.

    Raises:
        OSError: The system has no process or no file left.
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
        # Not by the environment: other programs of this user could read it there.
        with contextlib.suppress(BrokenPipeError):  # it has ended; its last line says why
            process.stdin.write(f"{token}\n")
            process.stdin.flush()
    return process
