"""Plays fixed lists of calls on many seeds of a scene, like an agent that does not adapt to results."""

import json
import random
from collections.abc import Iterator, Sequence
from typing import Any, cast

import numpy as np

from physment_mcp.errors import RefusedCall
from physment_mcp.session import Session
from physment_mcp.tools import TOOLS
from physment_mcp.tools.calls import call as make
from scenes.protocol import Call
from tests.harness.fuzz.drawing import MOODS, fitting_call
from tests.harness.fuzz.formulas import Array

MOST_CALLS = 12
_ATTEMPTS = 60
"""Number of calls that are drawn for a batch; refused calls are dropped."""
_READS = [tool.name for tool in TOOLS if tool.reads_only]


def draw_batch(session: Session, source: random.Random) -> list[Call]:
    """Generate random calls that a session accepts: interventions and steps, then readings. Restores the session."""
    public = session.scene.public
    longest = min(10.0, 0.9 * session.lab_time_left)
    mood = source.choice(MOODS)
    acts = [name for name in mood if name not in public.disabled_tools]
    reads = [name for name in _READS if name not in public.disabled_tools]
    changing, kept = source.randint(1, 6), list[Call]()
    with undone(session):
        if source.random() < 0.7 and any(item.permissions.hidden for item in session.state.objects.values()):
            kept += _accepted(session, Call("find_objects", {}))
        for _ in range(_ATTEMPTS):
            if len(kept) >= MOST_CALLS:
                break
            tool = source.choice(acts) if len(kept) < changing else source.choice(reads)
            asked = fitting_call(session, tool, source)
            if tool == "step":
                asked = Call(tool, {"duration": round(longest * 10 ** source.uniform(-2, 0), 3)})
            kept += _accepted(session, asked)
    return kept


def _accepted(session: Session, asked: Call) -> list[Call]:
    return [asked] if "error" not in _result(session, asked) else []


def _result(session: Session, asked: Call) -> dict[str, Any]:
    try:
        with np.errstate(all="ignore"):
            return make(session, asked.tool, asked.arguments).model_dump(mode="json")
    except RefusedCall:
        return {"error": 1.0}


class undone:  # noqa: N801 - reads as a word after `with`
    """Restore a session at the end of the block, its counters included."""

    def __init__(self, session: Session) -> None:
        self.session = session

    def __enter__(self) -> None:
        session = self.session
        self.saved = (session.world.save(), session.state, session.calls, session.counted_calls)

    def __exit__(self, *_: object) -> None:
        session = self.session
        world, session.state, session.calls, session.counted_calls = self.saved
        session.world.restore(world)


def play_batch(sessions: Sequence[Session], batch: Sequence[Call]) -> tuple[Array, list[str]]:
    """Play a batch in each session.

    Returns:
        The numbers of the results (sessions, numbers), NaN where a session has none; and their names.
    """
    rows: list[dict[str, float]] = []
    for session in sessions:
        row: dict[str, float] = {}
        with undone(session):
            for place, asked in enumerate(batch):
                named = f"{place + 1}.{asked.tool}({json.dumps(asked.arguments)[1:-1][:60]})"
                row |= {f"{named}{path}": value for path, value in _numbers(_result(session, asked), "")}
        rows.append(row)
    names = list(dict.fromkeys(name for row in rows for name in row))
    return np.array([[row.get(name, np.nan) for name in names] for row in rows], dtype=np.float64), names


def _numbers(value: Any, path: str) -> Iterator[tuple[str, float]]:
    if isinstance(value, bool | int | float):
        yield path, float(value)
    elif isinstance(value, dict):
        for name, part in cast("dict[str, Any]", value).items():
            yield from _numbers(part, f"{path}.{name}")
    elif isinstance(value, list):
        for place, part in enumerate(cast("list[Any]", value)):
            yield from _numbers(part, f"{path}[{place}]")
