"""Makes films: replays a stored episode and records its views. Raises if a result differs from the stored one."""

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractAsyncContextManager
from typing import Any

import mcp_types as types
from mcp import Client, MCPError
from pydantic import ValidationError

from evaluator.agents.recorded import exact_difference, play_again
from evaluator.episode.toolbox import Toolboxes, view_in, view_now
from evaluator.errors import InfrastructureError, UsageError
from evaluator.films.motion import Instant, reel
from evaluator.records.episode import Episode, EpisodeKey
from evaluator.report.film_record import Film
from evaluator.study.forking import described
from physment_mcp.contract.last_read import Reading, read_after

Opens = Callable[[EpisodeKey], AbstractAsyncContextManager[Client]]
"""Function that opens the laboratory of an episode for a client that receives views (`_meta` of results)."""


async def film_of(episode: Episode, opens: Opens, record_sha256: str, *, revealed: bool) -> Film:
    """Make the film of a stored episode.

    Args:
        episode: The stored episode.
        opens: Function that opens the laboratory of the episode.
        record_sha256: SHA-256 of the episode's line of `episodes.jsonl`; the film contains it.
        revealed: Whether the laboratory also shows what the agent could not see.

    Raises:
        UsageError: A result of the laboratory differs from the stored one, or the film would be too large.
    """
    camera = _Camera()
    now, problem = None, ""
    async with opens(episode.key) as client:
        try:
            camera.see(await view_now(client))
            now = await play_again(episode, client, Toolboxes(look=camera.look))
        except (InfrastructureError, MCPError) as error:
            # Raised after the block, because the client's task group would wrap it in an exception group.
            problem = str(error)
    if now is None:
        raise UsageError(f"{described(episode.key)} cannot be played again: {problem}")
    _refuse_other_returns(episode, now)
    looks = iter(camera.looks)
    instant = 0
    calls = [[instant := next(looks) if one.returned else instant for one in turn.exchanges] for turn in episode.turns]
    seen = reel(camera.instants, camera.drawings) | {"read": list(_changes(episode, camera.drawings))}
    try:
        return Film.model_validate({"episode": record_sha256, "revealed": revealed, "calls": calls, **seen})
    except ValidationError as error:
        raise UsageError(f"{described(episode.key)} gives no film: {error.errors()[0]['msg']}") from error


def _changes(episode: Episode, drawings: Sequence[Mapping[str, Any]]) -> Iterator[tuple[int, Mapping[str, Reading]]]:
    """Yield the last positions read of objects that are sometimes invisible, after each call that changed one."""
    always = set[str].intersection(*({body["id"] for body in drawing["bodies"]} for drawing in drawings))
    read: Mapping[str, Reading] = {}
    exchanges = (exchange for turn in episode.turns for exchange in turn.exchanges)
    for number, exchange in enumerate(exchanges):
        if not exchange.returned or exchange.is_error or exchange.content is None:
            continue
        before, read = read, read_after(read, exchange.call.tool, exchange.call.arguments, exchange.content)
        read = {name: reading for name, reading in read.items() if name not in always}
        if read != before:
            yield number, read


def _refuse_other_returns(stored: Episode, now: Episode) -> None:
    for turn, (before, after) in enumerate(itertools.zip_longest(stored.turns, now.turns), start=1):
        pairs = itertools.zip_longest(before.exchanges, after.exchanges if after else ())
        for number, (old, new) in enumerate(pairs, start=1):
            found = exact_difference(old, new) if new else ("", old.text, "nothing")
            if found is not None:
                _, was, returned = found
                raise UsageError(
                    f"{described(stored.key)}, turn {turn}, call {number} ({old.call.tool}): {was} is recorded, and the"
                    f" laboratory now returns {returned}"
                )


class _Camera:
    """Collects the instants of a film and its drawings, each drawing once."""

    def __init__(self) -> None:
        self.instants: list[Instant] = []
        self.drawings: list[Mapping[str, Any]] = []
        self.looks: list[int] = []
        """For each call, the index of the instant after it."""
        self._kept = 0
        """Number of leading instants that must be kept, because calls refer to them."""

    def look(self, result: types.CallToolResult) -> None:
        """Add the instants of a call's result."""
        self.see(view_in(result))
        self.looks.append(len(self.instants) - 1)

    def see(self, view: Mapping[str, Any] | None) -> None:
        """Add the instants of a view: those of the motion that it contains, then its present state."""
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
        # Of a period without motion, keep only the first and the last instant.
        last = self.instants[max(self._kept - 1, 0) :][-2:]
        still = len(last) == 2 and all(one.drawing == drawing and one.poses == poses for one in last)
        if still and len(self.instants) > self._kept:
            self.instants[-1] = instant
        else:
            self.instants.append(instant)
