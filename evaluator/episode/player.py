"""The contract of agents, and bounds on what they say.

An agent makes a player for each episode; the player takes the turns. Bounds keep an episode from filling the memory,
the disk or a report.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

from pydantic import JsonValue

from evaluator.records.episode import EpisodeKey, Exchange, ToolCall, Usage

ANSWER = "answer"
"""Name of the tool that ends an episode."""


@dataclass(frozen=True, slots=True)
class ToolDescription:
    """A tool as the server publishes it."""

    name: str
    description: str
    input_schema: Mapping[str, Any]


@dataclass(frozen=True, slots=True)
class Briefing:
    """Everything that an agent learns before its first turn."""

    prompt: str
    """The opening prompt: the task and what is known about the scene."""
    tools: tuple[ToolDescription, ...]
    budget: int
    """Iterations it may use."""
    scene: Mapping[str, Any]
    """The facts of the prompt as data: the server's resource of the open scene; empty if it publishes none."""


@dataclass(frozen=True, slots=True)
class Feedback:
    """What an agent learns after a turn."""

    exchanges: Sequence[Exchange]
    """Its calls, and what each returned."""
    note: str
    """What was wrong with the turn as a whole, or other advice; often empty."""
    remaining: int
    """Iterations left, including the next one."""


@dataclass(frozen=True, slots=True)
class Reply:
    """One turn of an agent, which costs one iteration."""

    reasoning: str = ""
    calls: tuple[ToolCall, ...] = ()
    """Run in this order; `answer` ends the episode."""
    malformed: str = ""
    """Why the reply could not be read; if set, no call is run."""
    usage: Usage | None = None
    thought_chars: int = 0
    """Characters at the start of `reasoning` that are not the reply, but what the provider shows of the model's own
    reasoning."""


class Player(Protocol):
    """An agent in one episode."""

    async def act(self, feedback: Feedback | None) -> Reply:
        """Take a turn.

        Args:
            feedback: The returns of the previous turn; None at the first turn.

        Raises:
            AgentError: The agent cannot continue. The episode ends and counts.
            InfrastructureError: Something that the agent needs failed. The episode is played again.
        """
        ...


class Agent(Protocol):
    """Plays episodes turn by turn."""

    @property
    def name(self) -> str:
        """Name in records and tables."""
        ...

    def player(self, key: EpisodeKey, briefing: Briefing) -> Player:
        """A new player for one episode.

        Args:
            key: Which episode. Randomness must follow from it, so that the episode can be played again.
            briefing: Everything that is known before the first turn.

        Raises:
            AgentError: The agent cannot play this episode.
        """
        ...


MAX_NESTING = 64
"""Most levels of lists and objects in a call. JSON readers fail at 200 levels, and a record must be readable."""
MAX_CALL_BYTES = 20_000
"""Most arguments of a call [bytes of JSON]; the laboratory refuses larger ones too."""
MAX_CALLS = 500
"""Most calls in a reply."""
MAX_REPLY_BYTES = 200_000
"""Most arguments of all calls in a reply [bytes of JSON]."""
MAX_REASONING = 200_000
"""Most characters of reasoning that are recorded of a reply."""
_MAX_SENTENCE = 1000
"""Most characters of a sentence that says what was wrong with a reply, which may repeat some of it."""


def bounded(reply: Reply) -> Reply:
    """The reply as it is recorded and run.

    Its reasoning is cut, with a remark, if it is too long. If a record could not hold its calls and be read again, or
    if they are too many or too large, then the reply counts as malformed and none of them is run.
    """
    problem = reply.malformed or _problem(reply.calls)
    return replace(
        reply,
        reasoning=_cut(as_text(reply.reasoning)),
        thought_chars=min(reply.thought_chars, MAX_REASONING),
        calls=() if problem else reply.calls,
        malformed=as_text(problem)[:_MAX_SENTENCE],
    )


def unrecordable(call: ToolCall) -> str:
    """Why a record cannot hold a call; empty if it can."""
    if _nests_deeper(call.arguments, MAX_NESTING):
        return f"a call nests more than {MAX_NESTING} levels"
    try:
        written = json.dumps([call.tool, call.arguments], ensure_ascii=False)
    except (TypeError, ValueError) as error:
        return f"a call is not JSON: {error}"
    if as_text(written) != written:
        return "a call holds half a surrogate pair, which is no text"
    size = len(written.encode())
    return f"a call has {size} bytes, more than {MAX_CALL_BYTES}" if size > MAX_CALL_BYTES else ""


def as_text(text: str) -> str:
    """Text that UTF-8 can hold: half surrogate pairs become question marks."""
    return text.encode("utf-8", "replace").decode("utf-8")


def _problem(calls: Sequence[ToolCall]) -> str:
    """Why the calls of a reply cannot be run and recorded; empty if they can."""
    if len(calls) > MAX_CALLS:
        return f"a reply has at most {MAX_CALLS} calls, not {len(calls)}"
    for call in calls:
        problem = unrecordable(call)
        if problem:
            return problem
    size = sum(len(json.dumps([call.tool, call.arguments], ensure_ascii=False).encode()) for call in calls)
    return f"the calls of a reply have at most {MAX_REPLY_BYTES} bytes, not {size}" if size > MAX_REPLY_BYTES else ""


def _cut(text: str) -> str:
    left_out = len(text) - MAX_REASONING
    return text if left_out <= 0 else f"{text[:MAX_REASONING]}\n[{left_out} characters are left out]"


def _nests_deeper(value: JsonValue, levels: int) -> bool:
    parts = value.values() if isinstance(value, dict) else value if isinstance(value, list) else ()
    return any(levels == 0 or _nests_deeper(part, levels - 1) for part in parts)
