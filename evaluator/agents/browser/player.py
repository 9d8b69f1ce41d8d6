"""A person in a browser as an agent, with the same briefing, tools and budget as every other agent.

`PageState` connects the agent to the page: the page reads the state and submits the person's turns. `Visitor` and
`Ending` hold what the page shows besides the episode. This module does not use HTTP.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import anyio
import mcp_types as types
from pydantic import JsonValue

from evaluator.agents.human import Left, refuse_commas
from evaluator.episode.player import ANSWER, Briefing, Feedback, Reply
from evaluator.episode.protocols.typed import TypingError
from evaluator.episode.toolbox import arguments_problem, joined, schema_validator, view_in
from evaluator.errors import RefusedRequest
from evaluator.records.episode import EpisodeKey, Exchange, ToolCall
from physment_mcp.contract.last_read import Reading, read_after


@dataclass(frozen=True, slots=True)
class Ending:
    """How an episode ended, for the page. Exists only after the episode is over and graded."""

    sentence: str
    correct: bool | None = None
    """Whether the answer is right; None if nothing was recorded."""
    key: JsonValue = None
    """The answer key; None if nothing was recorded."""
    answer: JsonValue = None
    """The accepted answer; None without one."""
    report: Path | None = None
    """The report of the episode; None if nothing was recorded."""
    choices: Mapping[str, str] = field(default_factory=dict[str, str])
    """Name of each choice for the next episode, such as `seed` or `next` → its text. Empty if there are none."""


@dataclass(slots=True)
class Visitor:
    """A person who takes part in a challenge, as the page shows it."""

    code: str
    """Pseudonym of the person in all records."""
    consent: str
    """One sentence that the person agrees to before the first episode."""
    ends_at: float | None = None
    """When the person's time ends, on the monotonic clock [s]; None before the consent, or without a limit."""
    agreed: bool = False
    minutes: float | None = None
    """Time from the consent on [min]; None without a limit."""


MOST_CALLS = 50
"""Largest number of calls in one turn."""
MOST_NOTE = 10_000
"""Largest number of characters in a note."""
_LEFT = "the person left without an answer"
_LOOK_S = 5.0
"""Interval at which an ended episode checks whether its page is still open [s]."""


@dataclass(slots=True)
class PageState:
    """State shared by the episode loop and the page: what the person sees, and the turn that the loop waits for."""

    visitor: Visitor | None = None
    """The person, if the page belongs to a challenge."""
    window: str = ""
    """Number of the open page; empty before the first request."""
    briefing: Briefing | None = None
    turns: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])
    """Results of the turns so far, in order."""
    left: int = 0
    """Remaining iterations."""
    view: Mapping[str, Any] | None = None
    """The current view, with the motion during the last step; None if the server sends no views."""
    waiting: bool = False
    """Whether the loop waits for the person's next turn."""
    ending: Ending | None = None
    """How the episode ended; None while it runs."""
    rules: Mapping[str, Any] = field(default_factory=dict[str, Any])
    """Limits and intermediate quantities that the prompt states, as JSON values: `limits` and `steps`."""
    number: int = 1
    """Number of the episode on this page, from 1."""
    version: int = 0
    """Incremented with every change."""
    seen_at: float = field(default_factory=time.monotonic)
    """Time of the page's last request on the monotonic clock [s]."""
    _changed: anyio.Event = field(default_factory=anyio.Event)
    _reply: Reply | None = None
    _gone: str = ""
    """Why the episode ends without an answer; empty while it goes on."""
    _agreed: anyio.Event = field(default_factory=anyio.Event)
    _turn_begins: bool = True
    """True until a result of the current turn contains a view. The motions of one turn are joined for playback."""
    _replied: anyio.Event = field(default_factory=anyio.Event)
    _choice: str | None = None
    _closed: bool = False
    _chosen: anyio.Event = field(default_factory=anyio.Event)

    def state(self) -> dict[str, Any]:
        """Return the state as JSON values; the page shows all of them."""
        briefing = self.briefing
        known = {} if briefing is None else {"prompt": briefing.prompt, "budget": briefing.budget}
        tools = [] if briefing is None else [asdict(tool) for tool in briefing.tools]
        scene = {} if briefing is None else dict(briefing.scene)
        ended = None if self.ending is None else self.ending.sentence
        shown = {"turns": self.turns, "left": self.left, "view": self.view, "read": self._read(), "ended": ended}
        about = {"version": self.version, "number": self.number, "waiting": self.waiting, "rules": dict(self.rules)}
        person = {"person": self._person()} if self.visitor else {}
        return {**about, **person, **known, "tools": tools, "scene": scene, **shown, "end": self._end()}

    def _person(self) -> dict[str, Any] | None:
        visitor = self.visitor
        if visitor is None:
            return None
        left = None if visitor.ends_at is None else max(0.0, visitor.ends_at - time.monotonic())
        clock = {"minutes": visitor.minutes, "seconds_left": left}
        return {"code": visitor.code, "consent": visitor.consent, "agreed": visitor.agreed, **clock}

    def _read(self) -> dict[str, Reading]:
        """Return the last reported position of each object, from the results of calls alone."""
        read: dict[str, Reading] = {}
        for one in (exchange for turn in self.turns for exchange in turn["exchanges"]):
            if one["returned"] and not one["is_error"] and one["content"] is not None:
                read = read_after(read, one["tool"], one["arguments"], one["content"])
        return read

    def _end(self) -> dict[str, Any] | None:
        end = self.ending
        if end is None:
            return None
        about = {"correct": end.correct, "key": end.key, "answer": end.answer, "choices": dict(end.choices)}
        return {**about, "report": end.report is not None}

    def change(self) -> None:
        """Increment the version and wake requests that wait for a change."""
        self.version += 1
        self._changed.set()
        self._changed = anyio.Event()

    async def newer_than(self, version: int, most_s: float) -> None:
        """Wait until the state is newer than a version.

        Args:
            version: Version that the page already has.
            most_s: Longest wall time to wait [s].
        """
        with anyio.move_on_after(most_s):
            while self.version <= version:
                await self._changed.wait()

    def take(self, calls: Sequence[ToolCall], note: str) -> None:
        """Accept a turn of the person. A refused turn uses no iteration.

        Args:
            calls: Calls of the turn.
            note: Text that is recorded as the reasoning of the turn.

        Raises:
            RefusedRequest: No turn is awaited, a call does not fit its tool's schema, or an answer is ambiguous.
        """
        if self.ending is not None:
            raise RefusedRequest(409, f"the episode is over: {self.ending.sentence}")
        if not self.waiting or self.briefing is None:
            raise RefusedRequest(409, "the last iteration is still running; wait for what it returns")
        if not 0 < len(calls) <= MOST_CALLS:
            raise RefusedRequest(400, f"an iteration has 1 to {MOST_CALLS} calls")
        schemas = {tool.name: tool.input_schema for tool in self.briefing.tools}
        for call in calls:
            if call.tool not in schemas:
                raise RefusedRequest(400, f"there is no tool {call.tool[:64]!r}")
            if problem := arguments_problem(schema_validator(schemas[call.tool]), call):
                raise RefusedRequest(400, problem)
        try:
            refuse_commas(calls)
        except TypingError as error:
            raise RefusedRequest(400, f"{ANSWER}: {error}") from None
        self._reply, self.waiting, self._turn_begins = Reply(note[:MOST_NOTE], tuple(calls)), False, True
        self._replied.set()
        self.change()

    def agree(self) -> None:
        """Record that the person agrees to take part in the challenge."""
        if self.visitor is not None and not self.visitor.agreed:
            self.visitor.agreed = True
            self._agreed.set()
            self.change()

    async def agreement(self) -> None:
        """Wait until the person agrees to take part, or leaves."""
        if self.visitor is None or not self.visitor.agreed:
            await self._agreed.wait()

    def leave(self, reason: str = _LEFT) -> None:
        """End the episode without an answer."""
        self._gone = reason
        self._replied.set()

    def look(self, result: types.CallToolResult) -> None:
        """Show the view of the scene that is attached to the result of a call, if any."""
        view = view_in(result)
        if view is not None:
            self.view = view if self.view is None or self._turn_begins else joined(self.view, view)
            self._turn_begins = False

    def show_briefing(self, briefing: Briefing) -> None:
        """Show the task before the first turn."""
        self.briefing, self.left = briefing, briefing.budget
        self.change()

    def show_return(self, feedback: Feedback) -> None:
        """Show the results of the last turn."""
        self.turns.append({"note": feedback.note, "exchanges": [_shown(one) for one in feedback.exchanges]})
        self.left = feedback.remaining
        self.change()

    def end(self, ending: Ending) -> None:
        """Show how the episode ended."""
        self.ending, self.waiting = ending, False
        self.change()

    def choose(self, choice: str) -> None:
        """Set the person's choice of what to play after an ended episode.

        Args:
            choice: One of `Ending.choices`.

        Raises:
            RefusedRequest: The episode still runs, or offers no such choice.
        """
        if self.ending is None or choice not in self.ending.choices:
            raise RefusedRequest(409, f"{choice[:64]!r} cannot be played now")
        self._choice = choice
        self._chosen.set()

    def close(self, reason: str = _LEFT) -> None:
        """End the episode without an answer if one runs; no further episode is played."""
        self._closed = True
        self._chosen.set()
        self._agreed.set()
        self.leave(reason)

    @property
    def is_closed(self) -> bool:
        """Whether no further episode will be played on this page."""
        return self._closed

    async def choice(self, absent_s: float) -> str | None:
        """Wait for the choice of what to play next; None if the page was closed.

        Args:
            absent_s: A page that has sent no request for this long counts as closed [s].
        """
        while not self._chosen.is_set() and time.monotonic() - self.seen_at < absent_s:
            with anyio.move_on_after(_LOOK_S):
                await self._chosen.wait()
        return None if self._closed else self._choice

    def begin(self) -> None:
        """Clear the state of the last episode, before the next one is opened."""
        self.briefing, self.view, self.ending, self.turns, self.left = None, None, None, [], 0
        self._choice, self._chosen, self._replied, self._gone = None, anyio.Event(), anyio.Event(), ""
        self.number += 1
        self.change()

    async def turn(self) -> Reply:
        """Wait for the person's next turn.

        Raises:
            Left: The person left without an answer.
        """
        self.waiting = not self._gone
        self.change()
        await self._replied.wait()
        reply, self._reply, self._replied = self._reply, None, anyio.Event()
        if self._gone or reply is None:
            raise Left(self._gone or _LEFT)
        return reply


@dataclass(frozen=True, slots=True)
class BrowserAgent:
    """An agent whose turns come from the browser page. Its records look like those of a person at a terminal."""

    page: PageState
    name: str = "human"

    def player(self, key: EpisodeKey, briefing: Briefing) -> "_BrowserPlayer":
        """Show the task and return the player."""
        del key
        self.page.show_briefing(briefing)
        return _BrowserPlayer(self.page)


@dataclass(frozen=True, slots=True)
class _BrowserPlayer:
    page: PageState

    async def act(self, feedback: Feedback | None) -> Reply:
        if feedback is not None:
            self.page.show_return(feedback)
        return await self.page.turn()


def _shown(exchange: Exchange) -> dict[str, Any]:
    shown = exchange.model_dump(mode="json", include={"returned", "is_error", "content", "text"})
    return {"tool": exchange.call.tool, "arguments": exchange.call.arguments, **shown}
