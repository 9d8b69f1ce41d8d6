"""Runs tool calls: takes a name and raw arguments, and returns a result, or refuses the call and changes nothing.

All callers use this module. It limits the size of a call before anything else reads its arguments.
"""

from collections.abc import Awaitable, Callable, Generator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, cast

import anyio.lowlevel
import anyio.to_thread
from pydantic import ValidationError

from physment_mcp.errors import BadArgument, BeyondLimit, NotAvailable, Unstable, quoted
from physment_mcp.session import Session
from physment_mcp.tools import TOOLS
from physment_mcp.tools.base import Arguments, Pieces, Progress, Tool
from physment_mcp.tools.episode import ANSWER, ANSWER_WITH_LAW
from physment_mcp.tools.results import Result

ReportProgress = Callable[[float, float], Awaitable[float | None]]
"""Callback with the work done and the total; returns the time that the next piece may take [s], None for the
usual one."""

_SHORT_S = 1e-3
"""Pieces with a shorter expected time [s] run without a thread, whose start takes up to 0.3 ms."""
_UNSHARED_S = 1.0
"""Time of a piece [s] if no other episode waits; Ctrl-C takes effect between pieces."""
MAX_NAME = 64
"""Longest name of a tool [characters]."""
MAX_CALL_BYTES = 20_000
"""Largest amount of text in the arguments, names and integers of more than 64 bits included [bytes of UTF-8]."""
MAX_ARGUMENTS = 32
"""Largest number of arguments of a call."""
MAX_VALUES = 4000
"""Largest number of values in the arguments of a call, lists and objects included."""
MAX_NESTING = 16
"""Deepest nesting of lists and objects in the arguments of a call."""
_SHORT = MAX_NAME
"""Longest text that is not counted [characters, each at most 4 bytes]."""
_FEW = 16
"""Longest list of numbers that is not counted."""
_LONG = 2**64
"""Smallest integer whose digits are counted as text; JSON allows thousands of digits."""

_BY_NAME = {tool.name: tool for tool in TOOLS}
_WITH_LAW = (*TOOLS[:-1], ANSWER_WITH_LAW)


def tools_of(session: Session | None) -> tuple[Tool[Any], ...]:
    """Return the tools of an episode. They are the same in all scenes, except that some ask for a law with the answer.

    Args:
        session: The episode; None if none is open.
    """
    return _WITH_LAW if session is not None and session.scene.public.law_answer else TOOLS


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
    session: Session,
    name: str,
    arguments: dict[str, Any],
    report: ReportProgress = no_progress,
    only_answer: str = "",
) -> Result:
    """Run one tool; long pieces of work run in a thread, report progress, and are undone if the task is cancelled.

    Args:
        session: The episode.
        name: Name of the tool.
        arguments: Its arguments as received.
        report: Callback with the progress.
        only_answer: Why every call except the answer is refused; empty if none is.

    Raises:
        RefusedCall: As for `call`.
    """
    tool, checked = _checked(session, name, arguments, only_answer)
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


def _checked(
    session: Session, name: str, arguments: dict[str, Any], only_answer: str = ""
) -> tuple[Tool[Any], Arguments]:
    """Count a call, and do all checks that are possible before it runs. Arguments as for `call_async`."""
    session.check_open()
    answers = name == ANSWER.name
    session.count_call(answers=answers)
    if only_answer and not answers:
        raise BeyondLimit(only_answer)
    too_large = excess(name, arguments)
    if too_large:
        raise BadArgument(too_large)
    tool = _BY_NAME.get(name)
    if tool is None:
        raise BadArgument(f"there is no tool {quoted(name)}; the tools are {', '.join(_BY_NAME)}")
    if answers:
        tool = tools_of(session)[-1]
    if name in session.scene.public.disabled_tools:
        raise NotAvailable(f"{name} is not available in this scene")
    return tool, tool.parse(arguments)


def _read(session: Session, tool: Tool[Any], checked: Arguments) -> Result:
    """Run a tool that only reads, so nothing has to be restored if it fails."""
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


def excess(name: str, arguments: Mapping[str, Any]) -> str:
    """Return a sentence about the first size limit that a call exceeds; empty if none.

    Args:
        name: Name of the tool, as the client wrote it.
        arguments: JSON values.
    """
    if len(name) <= MAX_NAME and len(arguments) <= MAX_ARGUMENTS:
        for key, value in arguments.items():
            if len(key) > _SHORT or not _is_small(value):
                break
        else:
            return ""  # fast path for most calls; the full check takes 15 to 50 µs
    return _excess(name, arguments)


def _excess(name: str, arguments: Mapping[str, Any]) -> str:
    if len(name) > MAX_NAME:
        return f"the name of a tool has at most {MAX_NAME} characters, not {len(name)}"
    if len(arguments) > MAX_ARGUMENTS:
        return f"a call has at most {MAX_ARGUMENTS} arguments, not {len(arguments)}"
    level: list[Any] = [arguments]
    values = size = 0
    for _ in range(MAX_NESTING + 1):
        size += sum(map(_text_of, level))
        level = [part for value in level for part in _parts(value)]
        values += len(level)
        if values > MAX_VALUES:
            return f"the arguments of a call hold at most {MAX_VALUES} values"
        if size > MAX_CALL_BYTES:
            return f"the arguments of a call hold at most {MAX_CALL_BYTES} bytes of text"
        if not level:
            return ""
    return f"the arguments of a call nest at most {MAX_NESTING} levels"


def _is_small(value: Any) -> bool:
    """Return whether a value is a number, a short text or a short vector. Calls of such values exceed no limit."""
    if isinstance(value, list):
        items = cast("list[Any]", value)
        return len(items) <= _FEW and all(map(_is_number, items))
    return value is None or _is_number(value) or (isinstance(value, str) and len(value) <= _SHORT)


def _is_number(value: Any) -> bool:
    """Return whether a value is a float or an integer of at most 64 bits."""
    return isinstance(value, float) or (isinstance(value, int) and -_LONG < value < _LONG)


def _text_of(value: Any) -> int:
    """Return the size of a value as text, without its parts [bytes]; for a long integer an estimate from its bits."""
    if isinstance(value, str):
        return len(value.encode("utf-8", "surrogatepass"))
    return value.bit_length() * 3 // 10 if isinstance(value, int) and not -_LONG < value < _LONG else 0


def _parts(value: Any) -> Sequence[Any]:
    """Return the items of a list, or the names and values of an object."""
    if isinstance(value, Mapping):
        named = cast("Mapping[Any, Any]", value)
        return [*named.keys(), *named.values()]
    return cast("list[Any]", value) if isinstance(value, list) else ()
