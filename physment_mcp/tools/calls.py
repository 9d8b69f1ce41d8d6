"""The one door of the laboratory: a tool name and raw arguments in, a result out, or a refusal that changed nothing."""

from contextlib import nullcontext
from typing import Any

from pydantic import ValidationError

from physment_mcp.errors import BadArgument, NotAvailable, Unstable
from physment_mcp.session import Session
from physment_mcp.tools import TOOLS, ReportProgress
from physment_mcp.tools.results import Result

_BY_NAME = {tool.name: tool for tool in TOOLS}


async def no_progress(_done: float, _total: float) -> None:
    """Report progress to nobody."""


async def call(session: Session, name: str, arguments: dict[str, Any], report: ReportProgress = no_progress) -> Result:
    """Run one tool. The caller runs one call at a time.

    Raises:
        RefusedCall: The call was refused; state, clock, loads and model are as before.
    """
    session.check_open()
    session.calls += 1
    tool = _BY_NAME.get(name)
    if tool is None:
        raise BadArgument(f"there is no tool {name!r}; the tools are {', '.join(_BY_NAME)}")
    if name in session.scene.disabled_tools:
        raise NotAvailable(f"{name} is not available in this scene")
    checked = tool.parse(arguments)
    # A tool that only reads has nothing to put back.
    with nullcontext() if tool.reads_only else session.all_or_nothing():
        try:
            return await tool.run(session, checked, report)
        except ValidationError:
            # The only values a result model can refuse are NaN and infinities.
            raise Unstable(f"{name}: the result is not a finite number, so the call was rolled back") from None
