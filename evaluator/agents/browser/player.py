"""A person in a browser as an agent, with the briefing, tools and budget of every other agent.

The page reads what it shows from `PageState` and puts the person's turns there. Knows no HTTP.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import anyio
import mcp_types as types

from evaluator.agents.human import Left, refuse_commas
from evaluator.episode.player import ANSWER, Briefing, Feedback, Reply
from evaluator.episode.protocols.typed import TypingError
from evaluator.episode.toolbox import first_problem, joined, schema_validator, view_in
from evaluator.errors import RefusedRequest
from evaluator.records.episode import EpisodeKey, Exchange, ToolCall

MOST_CALLS = 50
"""Most calls in an iteration of a person."""
MOST_NOTE = 10_000
"""Most characters of a note."""


@dataclass(slots=True)
class PageState:
    """What lies between the loop and the page: the episode as the person sees it, and the turn that is awaited."""

    briefing: Briefing | None = None
    turns: list[dict[str, Any]] = field(default_factory=list[dict[str, Any]])
    """What came back so far, turn by turn."""
    left: int = 0
    """Iterations left."""
    view: Mapping[str, Any] | None = None
    """What may be seen now, with the motion of the last step; None if the server does not tell."""
    waiting: bool = False
    """Whether the next turn is awaited from the person."""
    ended: str | None = None
    """How the episode ended, in a sentence; None while it goes on."""
    version: int = 0
    """Grows with every change."""
    _changed: anyio.Event = field(default_factory=anyio.Event)
    _reply: Reply | None = None
    _gone: bool = False
    _turn_begins: bool = True
    """Whether no result of this turn has shown anything yet: its motions are played as one."""
    _replied: anyio.Event = field(default_factory=anyio.Event)
    _told: anyio.Event = field(default_factory=anyio.Event)

    def state(self) -> dict[str, Any]:
        """All that the page shows, as JSON."""
        briefing = self.briefing
        known = {} if briefing is None else {"prompt": briefing.prompt, "budget": briefing.budget}
        tools = [] if briefing is None else [asdict(tool) for tool in briefing.tools]
        scene = {} if briefing is None else dict(briefing.scene)
        shown = {"turns": self.turns, "left": self.left, "view": self.view, "ended": self.ended}
        return {"version": self.version, "waiting": self.waiting, **known, "tools": tools, "scene": scene, **shown}

    def change(self) -> None:
        """Tell the page that something is new."""
        self.version += 1
        self._changed.set()
        self._changed = anyio.Event()

    async def newer_than(self, version: int, most_s: float) -> None:
        """Wait until there is something newer than a version, at most some wall time [s]."""
        with anyio.move_on_after(most_s):
            while self.version <= version:
                await self._changed.wait()

    def take(self, calls: Sequence[ToolCall], note: str) -> None:
        """Take a turn of the person.

        Raises:
            RefusedRequest: No turn is awaited, a call fits no tool, or an answer is ambiguous; it costs nothing.
        """
        if self.ended is not None:
            raise RefusedRequest(409, f"the episode is over: {self.ended}")
        if not self.waiting or self.briefing is None:
            raise RefusedRequest(409, "the last iteration is still running; wait for what it returns")
        if not 0 < len(calls) <= MOST_CALLS:
            raise RefusedRequest(400, f"an iteration has 1 to {MOST_CALLS} calls")
        schemas = {tool.name: tool.input_schema for tool in self.briefing.tools}
        for call in calls:
            if call.tool not in schemas:
                raise RefusedRequest(400, f"there is no tool {call.tool[:64]!r}")
            problem = first_problem(schema_validator(schemas[call.tool]), call.arguments)
            if problem:
                raise RefusedRequest(400, f"{call.tool}: {problem}")
        try:
            refuse_commas(calls)
        except TypingError as error:
            raise RefusedRequest(400, f"{ANSWER}: {error}") from None
        self._reply, self.waiting, self._turn_begins = Reply(note[:MOST_NOTE], tuple(calls)), False, True
        self._replied.set()
        self.change()

    def leave(self) -> None:
        """The person leaves without an answer."""
        self._gone = True
        self._replied.set()

    def look(self, result: types.CallToolResult) -> None:
        """Show what may be seen after a call, if its result says so."""
        view = view_in(result)
        if view is not None:
            self.view = view if self.view is None or self._turn_begins else joined(self.view, view)
            self._turn_begins = False

    def show_briefing(self, briefing: Briefing) -> None:
        """Show the task."""
        self.briefing, self.left = briefing, briefing.budget
        self.change()

    def show_return(self, feedback: Feedback) -> None:
        """Show what came back of the last turn."""
        self.turns.append({"note": feedback.note, "exchanges": [_shown(one) for one in feedback.exchanges]})
        self.left = feedback.remaining
        self.change()

    def end(self, sentence: str) -> None:
        """Say how the episode ended."""
        self.ended, self.waiting = sentence, False
        self.change()

    def told_end(self) -> None:
        """Note that the page has got the end."""
        if self.ended is not None:
            self._told.set()

    async def told(self, most_s: float) -> None:
        """Wait until the page has got the end, at most some wall time [s]."""
        with anyio.move_on_after(most_s):
            await self._told.wait()

    async def turn(self) -> Reply:
        """The next turn of the person.

        Raises:
            Left: The person left.
        """
        self.waiting = True
        self.change()
        await self._replied.wait()
        reply, self._reply, self._replied = self._reply, None, anyio.Event()
        if self._gone or reply is None:
            raise Left("the person left without an answer")
        return reply


@dataclass(frozen=True, slots=True)
class BrowserAgent:
    """Awaits each turn from the page. Recorded as the person at a terminal is."""

    page: PageState
    name: str = "human"

    def player(self, key: EpisodeKey, briefing: Briefing) -> "_BrowserPlayer":
        """Show the task."""
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
