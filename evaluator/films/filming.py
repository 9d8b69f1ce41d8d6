"""Plays a stored episode again and notes what is seen, unless the laboratory returns anything but what is stored."""

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractAsyncContextManager
from typing import Any

import mcp_types as types
from mcp import Client
from mcp.shared.exceptions import MCPError
from pydantic import ValidationError

from evaluator.errors import UsageError
from evaluator.films.reel import Instant, reel
from evaluator.records import Episode, EpisodeKey, Exchange
from evaluator.report.film_record import Film
from evaluator.study.forking import described
from physment_mcp.contract.names import VIEW, VIEW_URI

Opens = Callable[[EpisodeKey], AbstractAsyncContextManager[Client]]
"""What opens the laboratory of an episode for a client that is shown what is seen."""


async def film_of(episode: Episode, opens: Opens, record_sha256: str, *, revealed: bool) -> Film:
    """The film of an episode.

    Args:
        episode: As stored.
        opens: Opens its laboratory.
        record_sha256: Hash of its line, which the film carries.
        revealed: Whether the laboratory shows also what the agent could not see.

    Raises:
        UsageError: The laboratory returns something else than what is stored, or the film would be too large.
    """
    camera = _Camera()
    calls: list[list[int]] = [[] for _ in episode.turns]
    problem = ""
    async with opens(episode.key) as client:
        start = (await client.read_resource(VIEW_URI)).contents[0]
        assert isinstance(start, types.TextResourceContents)
        camera.see(json.loads(start.text))
        for turn, exchange in ((turn, one) for turn, played in enumerate(episode.turns) for one in played.exchanges):
            if exchange.returned:
                problem, view = await _played(client, exchange)
                if problem:
                    problem = f"{described(episode.key)}, turn {turn + 1}, call {len(calls[turn]) + 1} {problem}"
                    break
                camera.see(view)
            calls[turn].append(len(camera.instants) - 1)
    if problem:
        raise UsageError(problem)
    seen = reel(camera.instants, camera.drawings)
    try:
        return Film.model_validate({"episode": record_sha256, "revealed": revealed, "calls": calls, **seen})
    except ValidationError as error:
        raise UsageError(f"{described(episode.key)} gives no film: {error.errors()[0]['msg']}") from error


async def _played(client: Client, stored: Exchange) -> tuple[str, Mapping[str, Any] | None]:
    """Make a call again.

    Returns:
        How its return differs from what is stored, empty if it is the same to the last sign; and what is seen after the
        call, None if it changes nothing that is seen.
    """
    asked = types.CallToolRequestParams(name=stored.call.tool, arguments=stored.call.arguments)
    try:
        result = await client.session.send_request(types.CallToolRequest(params=asked), types.CallToolResult)
    except MCPError as error:
        return f"({stored.call.tool}): {stored.text} is recorded, and the laboratory now refuses it: {error}", None
    text = "\n".join(part.text for part in result.content if isinstance(part, types.TextContent))
    if text == stored.text and result.is_error == stored.is_error:
        return "", (result.meta or {}).get(VIEW)
    return f"({stored.call.tool}): {stored.text} is recorded, and the laboratory now returns {text}", None


class _Camera:
    """Collects what is seen: instants, and each drawing once."""

    def __init__(self) -> None:
        self.instants: list[Instant] = []
        self.drawings: list[Mapping[str, Any]] = []
        self._kept = 0
        """Number of instants that calls refer to."""

    def see(self, view: Mapping[str, Any] | None) -> None:
        """Add the motion that led to a view, and the view."""
        if view is None:
            return
        self._kept = len(self.instants)
        drawing = self._drawing(view["drawing"])
        motion: Mapping[str, Any] = view.get("motion") or {"times": (), "poses": {}}
        courses: Mapping[str, Sequence[Sequence[float]]] = motion["poses"]
        for place, time in enumerate(motion["times"]):
            self._add(time, drawing, view["poses"] | {name: course[place] for name, course in courses.items()})
        self._add(view["time"], drawing, view["poses"])

    def _drawing(self, drawing: Mapping[str, Any]) -> int:
        if drawing not in self.drawings:
            self.drawings.append(drawing)
        return self.drawings.index(drawing)

    def _add(self, time: float, drawing: int, poses: Mapping[str, Sequence[float]]) -> None:
        instant = Instant(time, drawing, poses)
        if self.instants and self.instants[-1] == instant:
            return
        # Of a time in which nothing moves, the ends are enough.
        last = self.instants[max(self._kept - 1, 0) :][-2:]
        still = len(last) == 2 and all(one.drawing == drawing and one.poses == poses for one in last)
        if still and len(self.instants) > self._kept:
            self.instants[-1] = instant
        else:
            self.instants.append(instant)
