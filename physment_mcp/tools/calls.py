"""The only entrance to the tools: a name and raw arguments in, a result out, or a refusal that changed nothing."""

from collections.abc import Awaitable, Callable, Generator
from contextlib import contextmanager
from typing import Any

import anyio.lowlevel
import anyio.to_thread
from pydantic import ValidationError

from physment_mcp.errors import BadArgument, NotAvailable, Unstable, quoted
from physment_mcp.session import Session
from physment_mcp.tools import TOOLS
from physment_mcp.tools.base import Arguments, Pieces, Progress, Tool
from physment_mcp.tools.bounds import excess
from physment_mcp.tools.episode import ANSWER
from physment_mcp.tools.results import Result

ReportProgress = Callable[[float, float], Awaitable[float | None]]
"""Receives how much of how much is done; returns the wall time that the next piece may take [s], None for the usual."""

_SHORT_S = 1e-3
"""Pieces that are expected to take less wall time [s] than this are not worth a thread, which takes up to 0.3 ms."""
_UNSHARED_S = 1.0
"""Wall time of a piece [s] if no other episode waits; Ctrl-C is heeded after it."""

_BY_NAME = {tool.name: tool for tool in TOOLS}


async def no_progress(_done: float, _total: float) -> None:
    """Ignore progress."""


def call(session: Session, name: str, arguments: dict[str, Any]) -> Result:
    """Run one tool and wait for its result. The caller runs one call at a time.

    Raises:
        RefusedCall: The call was refused; state, clock, loads and model are as before.
    """
    tool, checked = _checked(session, name, arguments)
    if tool.reads_only:
        return _read(session, tool, checked)
    with _all_or_nothing(session, tool):
        work = tool.run(session, checked)
        if isinstance(work, Result):
            return work
        made = _next(work)
        while isinstance(made, Progress):
            made = _next(work, _UNSHARED_S)
        return made


async def call_async(
    session: Session, name: str, arguments: dict[str, Any], report: ReportProgress = no_progress
) -> Result:
    """As `call`, but long pieces of work run in a thread, report progress, and are undone if the task is cancelled.

    Raises:
        RefusedCall: As for `call`.
    """
    tool, checked = _checked(session, name, arguments)
    if tool.reads_only:
        return _read(session, tool, checked)
    with _all_or_nothing(session, tool):
        work = tool.run(session, checked)
        if isinstance(work, Result):
            return work
        made = _next(work)
        while isinstance(made, Progress):
            done, total, next_s = made
            if done < total:
                most_s = await report(done, total) if done > 0 else None
                short = next_s < _SHORT_S
                made = _next(work, most_s) if short else await anyio.to_thread.run_sync(_next, work, most_s)
            else:
                # A caller that cancels during the last piece gets no result, so the call must change nothing.
                await anyio.lowlevel.checkpoint_if_cancelled()
                made = _next(work)
        return made


def _checked(session: Session, name: str, arguments: dict[str, Any]) -> tuple[Tool[Any], Arguments]:
    """Count a call, and check all that can be known before it runs."""
    session.check_open()
    session.count_call(answers=name == ANSWER.name)
    too_large = excess(name, arguments)
    if too_large:
        raise BadArgument(too_large)
    tool = _BY_NAME.get(name)
    if tool is None:
        raise BadArgument(f"there is no tool {quoted(name)}; the tools are {', '.join(_BY_NAME)}")
    if name in session.scene.public.disabled_tools:
        raise NotAvailable(f"{name} is not available in this scene")
    return tool, tool.parse(arguments)


def _read(session: Session, tool: Tool[Any], checked: Arguments) -> Result:
    """The result of a tool that only reads, so nothing has to be restored if it fails."""
    try:
        made = tool.run(session, checked)
    except ValidationError:
        raise _not_finite(tool) from None
    assert isinstance(made, Result)
    return made


@contextmanager
def _all_or_nothing(session: Session, tool: Tool[Any]) -> Generator[None]:
    """Undo the call of a tool if the block fails or is cancelled."""
    with session.all_or_nothing():
        try:
            yield
        except ValidationError:
            raise _not_finite(tool) from None


def _not_finite(tool: Tool[Any]) -> Unstable:
    # The only values a result model can refuse are NaN and infinities.
    return Unstable(f"{tool.name}: the result is not a finite number, so the call was rolled back")


def _next(pieces: Pieces, most_s: float | None = None) -> Progress | Result:
    # StopIteration cannot pass through a thread or a coroutine.
    try:
        return pieces.send(most_s)
    except StopIteration as end:
        return end.value
