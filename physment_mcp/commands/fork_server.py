"""`physment-mcp fork-server`: starts a process for each episode without importing its modules again.

Importing the engine and the MCP SDK takes most of a second of processor time. This process imports them once and forks:
each child is `physment-mcp --scene N` on its own stdin and stdout. POSIX only.
"""

import argparse
import contextlib
import gc
import json
import os
import signal
import socket
import sys
import traceback
from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from types import FrameType

from physment_mcp.commands.base import Commands, common_options
from physment_mcp.errors import UsageError

_LOADED = ("mcp.server.stdio", "physment_mcp.serving.views", "physment_mcp.serving.server", "physment_mcp.session")
"""Modules that an episode on stdio imports directly; these import all others that it needs."""
_LONGEST_LINE = 64_000
"""Longest accepted first line [bytes]."""
_PATIENCE_S = 5
"""Time for children to exit before they are killed [s]."""

Program = Callable[[Sequence[str]], int]
"""Takes the words of a command line and returns an exit code."""


def add(commands: Commands, program: Program) -> None:
    """Declare `fork-server`. It has no `help`, so `--help` omits it: programs start it, not people.

    Args:
        commands: The object on which commands are declared.
        program: The function that a child runs with its command line.
    """
    command = commands.add_parser(
        "fork-server",
        parents=[common_options(again=True)],
        description="Load everything, then start episodes on stdio by forking. For each, the program that started this"
        " one sends a byte through the control socket, with two descriptors: a socket, which becomes stdin and stdout,"
        ' and one for stderr. The first line on the socket is a JSON list of words, such as ["--scene", "7"].',
    )
    command.add_argument(
        "--control-fd", type=int, required=True, metavar="FD", help="descriptor of an inherited Unix socket"
    )
    command.set_defaults(run=partial(_run, program))


def _run(program: Program, args: argparse.Namespace) -> int:
    """Fork until the other end of the control socket is closed.

    Raises:
        UsageError: This system does not fork, or the descriptor is not that of a Unix socket.
    """
    if not hasattr(os, "fork") or not hasattr(socket, "recv_fds"):
        raise UsageError("this system does not fork processes; start physment-mcp --scene N for each episode")
    try:
        control = socket.socket(fileno=args.control_fd)
    except (OSError, OverflowError, ValueError):
        raise UsageError(f"--control-fd {args.control_fd}: is not the descriptor of an open Unix socket") from None
    for name in _LOADED:
        import_module(name)
    gc.collect()
    gc.freeze()  # children share these pages: their garbage collection does not touch them
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # the system reaps children
    while True:
        mark, brought, _, _ = socket.recv_fds(control, 1, 2)
        if not mark:
            return _ended()
        if len(brought) == 2 and os.fork() == 0:
            code = 1
            try:
                control.close()
                code = _episode(brought, program)
            except Exception:  # noqa: BLE001 - print it, as the interpreter would
                traceback.print_exc()
            finally:
                os._exit(code)  # a child must not continue this loop
        for descriptor in brought:
            os.close(descriptor)


def _ended() -> int:
    """Wait for the children, which exit at the end of their stdin, and kill the rest; returns the exit code."""
    signal.signal(signal.SIGALRM, _kill_group)
    if os.getpid() == os.getpgrp():  # otherwise the group has other members than our children
        signal.alarm(_PATIENCE_S)
    # With SIGCHLD ignored, this returns when no child is left.
    with contextlib.suppress(ChildProcessError):
        os.wait()
    return 0


def _kill_group(_sign: int, _frame: FrameType | None) -> None:
    os.killpg(0, signal.SIGKILL)


def _episode(brought: Sequence[int], program: Program) -> int:
    """Run an episode on these descriptors; returns the exit code."""
    connection, errors = brought
    for source, target in ((connection, 0), (connection, 1), (errors, 2)):
        os.dup2(source, target)
    for descriptor in brought:
        os.close(descriptor)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    try:
        return program(_words())
    except SystemExit as end:  # invalid command line
        return end.code if isinstance(end.code, int) else 1
    finally:
        sys.stdout.flush()
        sys.stderr.flush()


def _words() -> list[str]:
    """Parse the first line of stdin, read byte by byte because the bytes after it belong to MCP."""
    line = bytearray()
    while (byte := os.read(0, 1)) not in {b"", b"\n"} and len(line) < _LONGEST_LINE:
        line += byte
    words: list[str] = json.loads(line)
    return words
