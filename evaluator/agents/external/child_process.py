"""Runs a command in its own process group, with a time limit and bounded capture of its output.

This module does not depend on MCP, agents or episodes.
"""

import contextlib
import os
import signal
import subprocess
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import anyio
from anyio.abc import ByteReceiveStream, ByteSendStream, Process

from evaluator.agents.external.isolation import EpisodeFolders, SystemUser

_KEPT = 64 * 1024
"""Number of bytes kept from the end of each output stream."""
_TERM_S = 2.0
"""Wall time between SIGTERM and SIGKILL [s]."""
_FLUSH_S = 2.0
"""Wall time to wait for remaining output after the process has ended [s]."""
_WATCH = """trap '' HUP INT TERM; read -r line; kill -s KILL -- "-$1"; rm -rf -- "$2\""""


@dataclass(slots=True)
class _Tail:
    """A buffer that keeps the last bytes of a stream."""

    content: bytearray = field(default_factory=bytearray)
    ended: anyio.Event = field(default_factory=anyio.Event)

    async def drain(self, stream: ByteReceiveStream) -> None:
        """Read a stream to its end, so that its writer never blocks on a full pipe."""
        try:
            async for chunk in stream:
                self.content += chunk
                del self.content[:-_KEPT]
        except anyio.BrokenResourceError:
            pass
        finally:
            self.ended.set()

    def text(self) -> str:
        return self.content.decode("utf-8", "replace")


@dataclass(frozen=True, slots=True)
class Ended:
    """Exit status and captured output of a command."""

    code: int | None
    """Exit code, negative for a signal; None if the command was stopped."""
    out_of_time: bool
    """True if the command was stopped because its wall time was used up."""
    stdout: str
    """The end of its standard output."""
    stderr: str
    """The end of its standard error."""


async def run_child(
    command: Sequence[str],
    *,
    folders: EpisodeFolders,
    env: Mapping[str, str],
    stdin: str | None,
    max_wall_s: float,
    until: Callable[[], Awaitable[None]],
    user: SystemUser | None = None,
) -> Ended:
    """Run a command until it exits or must be stopped. No process of its group survives this call.

    Args:
        command: Program and arguments.
        folders: Working, home and temporary folders; removed if this process is killed.
        env: Complete environment of the command.
        stdin: Text sent to its standard input; None for an empty input.
        max_wall_s: Most wall time [s].
        until: Asynchronous function; when it returns, the command is stopped.
        user: System user that runs it; None for the user of this process.

    Raises:
        OSError: The command cannot be started.
    """
    process = await _open(command, folders.work, env, user, reads=stdin is not None)
    assert process.stdout is not None
    assert process.stderr is not None
    out, err, limit = _Tail(), _Tail(), anyio.CancelScope(deadline=anyio.current_time() + max_wall_s)
    code, stopped = None, False
    watchdog = _start_watchdog(process.pid, folders.base)
    try:
        async with anyio.create_task_group() as streams:
            streams.start_soon(out.drain, process.stdout)
            streams.start_soon(err.drain, process.stderr)
            if stdin is not None and process.stdin is not None:
                streams.start_soon(_feed, process.stdin, stdin)
            with limit:
                await _wait(process, until)
            code = process.returncode
            await _stop_group(process)
            stopped = True
            with anyio.move_on_after(_FLUSH_S):
                await out.ended.wait()
                await err.ended.wait()
            streams.cancel_scope.cancel()
    finally:
        with anyio.CancelScope(shield=True):
            if not stopped:
                await _stop_group(process)
            await process.aclose()
            _end_watchdog(watchdog)
    return Ended(code, out_of_time=limit.cancelled_caught, stdout=out.text(), stderr=err.text())


async def _open(
    command: Sequence[str], cwd: Path, env: Mapping[str, str], user: SystemUser | None, *, reads: bool
) -> Process:
    """Start the command in a new process group."""
    return await anyio.open_process(
        list(command),
        stdin=subprocess.PIPE if reads else subprocess.DEVNULL,
        cwd=cwd,
        env=env,
        start_new_session=True,
        user=None if user is None else user.uid,
        group=None if user is None else user.gid,
        extra_groups=None if user is None else [],
    )


def _start_watchdog(group: int, folder: Path) -> subprocess.Popen[bytes]:
    """Start a watchdog that kills a process group and removes a folder if this process dies.

    The watchdog reads from a pipe, which the operating system closes when this process ends for any reason.
    """
    return subprocess.Popen(  # noqa: S603 - our own script
        ["/bin/sh", "-c", _WATCH, "sh", str(group), str(folder)],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


def _end_watchdog(watchdog: subprocess.Popen[bytes]) -> None:
    watchdog.kill()
    watchdog.wait()
    assert watchdog.stdin is not None
    watchdog.stdin.close()


async def _wait(process: Process, until: Callable[[], Awaitable[None]]) -> None:
    """Wait until the process exits or `until` returns."""
    async with anyio.create_task_group() as either:

        async def stop_early() -> None:
            await until()
            either.cancel_scope.cancel()

        either.start_soon(stop_early)
        await process.wait()
        either.cancel_scope.cancel()


async def _feed(stream: ByteSendStream, text: str) -> None:
    with contextlib.suppress(anyio.BrokenResourceError, anyio.ClosedResourceError):
        await stream.send(text.encode("utf-8", "replace"))
        await stream.aclose()


async def _stop_group(process: Process) -> None:
    """End the process and its group: SIGTERM first, then SIGKILL."""
    if process.returncode is None:
        _signal_group(process.pid, signal.SIGTERM)
        with anyio.move_on_after(_TERM_S):
            await process.wait()
    # Also if the process has exited: its children may still run and hold its streams open.
    _signal_group(process.pid, signal.SIGKILL)
    await process.wait()


def _signal_group(pid: int, sign: signal.Signals) -> None:
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(pid, sign)
