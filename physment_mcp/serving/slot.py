"""The slot for one episode in a server: the open episode, how to open another episode, and the call log.

The log serves the agent itself and the program that opened the episode. External programs report nothing to the
evaluator, so the evaluator grades their episodes by this log. Depends on sessions and MCP results; contains no MCP
handlers, transports or file access.
"""

import json
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import mcp_types as types
from pydantic_core import from_json, to_json

from physment_mcp.contract.last_read import Reading, read_after
from physment_mcp.errors import EpisodeGone, EpisodeOver
from physment_mcp.scene import Scene
from physment_mcp.serving.scheduling import Scheduler, Turns
from physment_mcp.serving.views import Frames
from physment_mcp.session import Session
from physment_mcp.tools.calls import MAX_NAME, excess
from physment_mcp.tools.episode import ANSWER
from physment_mcp.visibility import Visibility
from scenes import PublicPack

MAX_EPISODE_BYTES = 4_000_000
"""Largest total size of the arguments in an episode [bytes of JSON]; 10,000 typical calls take half of it."""
MAX_PAGE_BYTES = 30_000
"""Largest size of arguments and results in one page of the log [bytes]; serialising it takes 1 ms."""
FULL = f"the calls of this episode have brought {MAX_EPISODE_BYTES} bytes, which is the limit; you can only answer now"
_TRUTH = {True: "true", False: "false"}
KEPT_CALLS = 500
"""Number of calls that the log keeps of an episode without a call limit. Limits the memory of a server."""


class LoggedCall(NamedTuple):
    """One tool call that reached the laboratory."""

    tool: str
    written: bytes
    """The arguments as received, in JSON; NaN and infinities as strings, because JSON has no numbers for them."""
    text: str | None
    """The text that the client received: a result in JSON, or an error message; None if it cancelled the call."""
    is_error: bool
    started_s: float
    """Wall time since the episode was opened [s]."""
    duration_s: float

    @property
    def size(self) -> int:
        """Approximate size of arguments and result [bytes]."""
        return len(self.written) + len(self.text or "")

    @property
    def result(self) -> str | None:
        """The structured result in JSON; None if the call was refused or cancelled."""
        return None if self.is_error else self.text

    def as_json(self) -> str:
        """Return the call as JSON, for the owner of the episode. Arguments and result are serialised already."""
        return (
            f'{{"tool":{json.dumps(self.tool)},"arguments":{self.written.decode()},'
            f'"returned":{_TRUTH[self.text is not None]},"is_error":{_TRUTH[self.is_error]},'
            f'"content":{self.result or "null"},"text":{json.dumps(self.text or "")},'
            f'"started_s":{self.started_s:.6f},"duration_s":{self.duration_s:.6f}}}'
        )

    def as_note(self, number: int) -> str:
        """Return the call for the agent, as JSON: the information it received, without wall-clock times.

        Args:
            number: Number of the call in the episode, from 1.
        """
        if self.text is None:
            seen = '"taken_back":true'
        else:
            seen = f'"refused":{json.dumps(self.text)}' if self.is_error else f'"result":{self.text}'
        return f'{{"call":{number},"tool":{json.dumps(self.tool)},"arguments":{self.written.decode()},{seen}}}'


@dataclass(slots=True)
class CallLog:
    """The calls of one episode, in order."""

    kept: int | None = None
    """Number of latest calls to keep; None for all."""
    calls: list[LoggedCall] = field(default_factory=list[LoggedCall])
    left_out: int = 0
    """Number of calls that are no longer kept."""
    size: int = 0
    """Size of all arguments so far [bytes]."""
    opened_at: float = field(default_factory=time.monotonic)
    _readings: Mapping[str, Reading] = field(default_factory=dict[str, Reading])
    _read_calls: int = 0
    """Number of calls whose results are in `_readings`."""

    @property
    def full(self) -> bool:
        """Whether the arguments in the log exceed its size limit, so that only the answer is accepted."""
        return self.size > MAX_EPISODE_BYTES

    def page_from(self, first: int) -> Sequence[LoggedCall]:
        """Return the calls from an index on that fit on a page; at least one call if there are any.

        Args:
            first: Index in `calls`, from 0.
        """
        size, end = 0, first
        while end < len(self.calls) and (size := size + self.calls[end].size) <= MAX_PAGE_BYTES:
            end += 1
        return self.calls[first : max(end, first + 1)]

    def newest_page(self) -> Sequence[LoggedCall]:
        """Return the newest calls that fit on a page."""
        size, first = 0, len(self.calls)
        while first > 0 and (size := size + self.calls[first - 1].size) <= MAX_PAGE_BYTES:
            first -= 1
        return self.calls[first:]

    def readings(self) -> Mapping[str, Reading]:
        """Return the last position reading of each object, from the results of this episode.

        Only clients that show the app need them. They are therefore computed on request, from the calls since the last
        request; a call that the log drops before a request is included.
        """
        for call in self.calls[self._read_calls - self.left_out :]:
            self._read(call)
        return self._readings

    def _read(self, call: LoggedCall) -> None:
        if call.result is not None:
            arguments, content = from_json(call.written), from_json(call.result)
            self._readings = read_after(self._readings, call.tool, arguments, content)
        self._read_calls += 1

    def add(self, params: types.CallToolRequestParams, result: types.CallToolResult | None, started_at: float) -> None:
        """Record a call.

        Args:
            params: The call.
            result: The result that the client received; None if it cancelled the call.
            started_at: Start of the call on the monotonic clock [s].
        """
        arguments = params.arguments or {}
        # Arguments that were refused as too large are not kept: they may be an attempt to exhaust the memory.
        too_large = excess(params.name, arguments)
        is_error = result is not None and bool(result.is_error)
        if too_large or (self.full and (is_error or params.name != ANSWER.name)):
            arguments = {"left_out": too_large or FULL}
        written = to_json(arguments, inf_nan_mode="strings")
        # Only the text is kept: result objects made later calls a tenth slower by repeated garbage collection.
        texts = (part.text for part in result.content if isinstance(part, types.TextContent)) if result else ()
        text = next(iter(texts), "") if result else None
        took = time.monotonic() - started_at
        self.size += len(written)
        self.calls.append(
            LoggedCall(params.name[:MAX_NAME], written, text, is_error, started_at - self.opened_at, took)
        )
        if self.kept is not None and len(self.calls) > self.kept:
            if self._read_calls == self.left_out:
                self._read(self.calls[0])
            self.left_out += 1
            del self.calls[0]


class EpisodeSlot:
    """Holds at most one open episode; its calls run one at a time."""

    def __init__(
        self,
        session: Session | None = None,
        *,
        reopen: Callable[[int], Session] | None = None,
        scene_ids: Sequence[int] = (),
        list_scenes: Callable[[], Sequence[PublicPack]] | None = None,
        gone: str | None = None,
        watch: Callable[[Session], Frames] | None = None,
        scheduler: Scheduler | None = None,
        find_visibility: Callable[[Scene], Visibility] | None = None,
    ) -> None:
        """Create the slot.

        Args:
            session: The open episode; None if clients choose the scene.
            reopen: Function that opens an episode by scene id, if clients choose the scene.
            scene_ids: Ids of the scenes that can be opened; by default the open one.
            list_scenes: Function that lists the scenes that can be opened; by default the open one.
            watch: Function that creates the source of images for results; None for results without images.
            gone: Why there is no episode and none can be opened; None otherwise.
            find_visibility: Function that returns what the app may display of a scene; None without the app.
            scheduler: Scheduler that decides which episode simulates next; None for a single episode.
        """
        self.session = session
        self.reopen = reopen
        self.scene_ids = scene_ids or ([] if session is None else [session.scene.public.scene_id])
        self.gone = gone
        self.turns = Turns(scheduler)
        self.log = CallLog()
        self.frames: Frames | None = None
        self._watch = watch
        self._find_visibility = find_visibility
        self._list_scenes = list_scenes
        if session is not None:
            self.enter(session)

    @property
    def offers_app(self) -> bool:
        """Whether the app is offered. Episodes with a limit on calls do not offer it, because a view is not a call."""
        return self._find_visibility is not None and (self.session is None or self.session.max_calls is None)

    def visibility(self, session: Session) -> Visibility:
        """Return the visibility of a session's scene. Call it only where the app is offered. Blocks.

        Raises:
            SceneError: The folder holds too few variants of the scene.
        """
        assert self._find_visibility is not None
        return self._find_visibility(session.scene)

    @property
    def fixed(self) -> bool:
        """True if no other episode can be opened here."""
        return self.reopen is None and self.session is not None

    def enter(self, session: Session) -> None:
        """Make a session the open episode, with an empty log."""
        frames = None if self._watch is None else self._watch(session)
        self.session, self.frames = session, frames
        # With a limit, the log is the record of the episode for its owner, so it must be complete.
        self.log = CallLog(kept=KEPT_CALLS if session.max_calls is None else None)

    def close(self, gone: str) -> None:
        """Release the episode: its model and state take a megabyte that the garbage collector does not count.

        Args:
            gone: The reply to further calls, which says why the episode no longer exists.
        """
        self.session, self.frames, self.gone, self.log = None, None, gone, CallLog()

    def open_session(self) -> Session:
        """Return the open episode.

        Raises:
            EpisodeGone: The episode no longer exists, and none can be opened here.
            EpisodeOver: No scene is open yet.
        """
        if self.gone is not None:
            raise EpisodeGone(self.gone)
        if self.session is None:
            raise EpisodeOver("no scene is open yet: use the prompt `scene` with a scene_id to open one")
        return self.session

    @cached_property
    def catalogue(self) -> tuple[PublicPack, ...]:
        """Return the scenes that can be opened here."""
        if self._list_scenes is not None:
            return tuple(self._list_scenes())
        return () if self.session is None else (self.session.scene.public,)
