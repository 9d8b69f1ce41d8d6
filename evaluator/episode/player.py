"""The protocols that agents implement, and limits on the size of their replies.

An agent creates a player for each episode, and the player takes the turns. The limits keep one episode from filling
the memory, the disk or a report.
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
    """The opening prompt: the task, and the public facts about the scene."""
    tools: tuple[ToolDescription, ...]
    budget: int
    """Number of iterations that the agent may use."""
    scene: Mapping[str, Any]
    """Content of the server's resource for the open scene; empty if there is none. The prompt states the same facts."""


@dataclass(frozen=True, slots=True)
class Feedback:
    """What an agent receives after a turn."""

    exchanges: Sequence[Exchange]
    """The calls of the turn with their results."""
    note: str
    """A problem of the whole turn, or advice; often empty."""
    remaining: int
    """Remaining iterations, including the next one."""


@dataclass(frozen=True, slots=True)
class Reply:
    """One turn of an agent, which costs one iteration."""

    reasoning: str = ""
    calls: tuple[ToolCall, ...] = ()
    """Calls, run in this order; an accepted `answer` ends the episode."""
    malformed: str = ""
    """Why the reply could not be parsed; if not empty, no call is run."""
    usage: Usage | None = None
    thought_chars: int = 0
    """Number of characters at the start of `reasoning` that are the model's own reasoning as the provider shows it, and
    not part of the reply."""


class Player(Protocol):
    """An agent in one episode."""

    async def act(self, feedback: Feedback | None) -> Reply:
        """Take a turn.

        Args:
            feedback: Results of the previous turn; None at the first turn.

        Raises:
            AgentError: The agent cannot continue. The episode ends and counts as a failure.
            InfrastructureError: A service that the agent needs failed. The episode is played again.
        """
        ...


class Agent(Protocol):
    """Plays episodes turn by turn. Creates one player per episode."""

    @property
    def name(self) -> str:
        """Name in records and tables."""
        ...

    def player(self, key: EpisodeKey, briefing: Briefing) -> Player:
        """Create a player for one episode.

        Args:
            key: Key of the episode. Random numbers must be seeded from it, so that the episode can be repeated.
            briefing: Everything that is known before the first turn.

        Raises:
            AgentError: The agent cannot play this episode.
        """
        ...


MAX_NESTING = 64
"""Deepest nesting of lists and objects in a call. JSON parsers fail at 200 levels, and records must be readable."""
MAX_CALL_BYTES = 20_000
"""Largest size of a call's arguments [bytes of JSON]; the server has the same limit."""
MAX_CALLS = 500
"""Largest number of calls in a reply."""
MAX_REPLY_BYTES = 200_000
"""Largest total size of the arguments in a reply [bytes of JSON]."""
MAX_REASONING = 200_000
"""Largest number of characters recorded of a reply's reasoning."""
_MAX_SENTENCE = 1000
"""Largest number of characters of an error message about a reply, which may quote the reply."""


def bounded(reply: Reply) -> Reply:
    """Return the reply as it is recorded and run.

    Reasoning that is too long is truncated with a remark. If a record could not hold the calls, or if they are too many
    or too large, the reply counts as malformed and none of them is run.
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
    """Explain why a record cannot hold a call; empty if it can."""
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
    """Replace lone surrogates, which UTF-8 cannot encode, by question marks."""
    return text.encode("utf-8", "replace").decode("utf-8")


def _problem(calls: Sequence[ToolCall]) -> str:
    """Explain why the calls of a reply cannot be run and recorded; empty if they can."""
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
