"""Baseline agents: a random guess, random calls followed by a guess, and any agent limited to one batch of calls."""

import random
from dataclasses import dataclass, field, replace
from typing import Any

from evaluator.episode.player import ANSWER, Agent, Briefing, Feedback, Player, Reply
from evaluator.records.episode import EpisodeKey, ToolCall

GUESS_RANGE = (0.01, 100.0)
"""Range of numeric guesses, which are drawn log-uniformly."""
_CALLS_PER_TURN = 4


@dataclass(frozen=True, slots=True)
class BlindAgent:
    """Answers at once without any call: a random option, or a log-uniform random number."""

    name: str = "blind"

    def player(self, key: EpisodeKey, briefing: Briefing) -> "_BlindPlayer":
        """Return a player whose guess is a deterministic function of the episode key."""
        return _BlindPlayer(briefing, _source(self.name, key))


@dataclass(slots=True)
class _BlindPlayer:
    briefing: Briefing
    source: random.Random

    async def act(self, feedback: Feedback | None) -> Reply:
        del feedback
        guess = _guess(self.briefing, self.source)
        return Reply("I guess.", (ToolCall(tool=ANSWER, arguments={"answer": guess}),))


@dataclass(frozen=True, slots=True)
class RandomAgent:
    """Calls random tools with arguments drawn from their schemas, and guesses in its last turn."""

    turns: int = 3
    name: str = "random"

    def player(self, key: EpisodeKey, briefing: Briefing) -> "_RandomPlayer":
        """Return a player whose calls are a deterministic function of the episode key."""
        return _RandomPlayer(briefing, _source(self.name, key), min(self.turns, briefing.budget))


@dataclass(slots=True)
class _RandomPlayer:
    briefing: Briefing
    source: random.Random
    turns: int
    taken: int = 0

    async def act(self, feedback: Feedback | None) -> Reply:
        del feedback
        self.taken += 1
        if self.taken >= self.turns:
            guess = _guess(self.briefing, self.source)
            return Reply("I guess.", (ToolCall(tool=ANSWER, arguments={"answer": guess}),))
        tools = [tool for tool in self.briefing.tools if tool.name != ANSWER]
        ids = [str(listed["object_id"]) for listed in self.briefing.scene.get("objects", [])] or ["object_1"]
        calls: list[ToolCall] = []
        for _ in range(_CALLS_PER_TURN):
            tool = tools[int(self.source.random() * len(tools))]
            calls.append(ToolCall(tool=tool.name, arguments=random_arguments(tool.input_schema, ids, self.source)))
        return Reply("I try something.", tuple(calls))


@dataclass(frozen=True, slots=True)
class OracleOnceAgent:
    """Lets an inner agent make one batch of calls and read its results; the next turn must answer."""

    inner: Agent

    @property
    def name(self) -> str:
        """`oracle-once:` and the inner agent's name."""
        return f"oracle-once:{self.inner.name}"

    def player(self, key: EpisodeKey, briefing: Briefing) -> "_OracleOncePlayer":
        """Return the inner agent's player, limited to two turns."""
        return _OracleOncePlayer(self.inner.player(key, briefing))


@dataclass(slots=True)
class _OracleOncePlayer:
    inner: Player
    replies: list[Reply] = field(default_factory=list[Reply])

    async def act(self, feedback: Feedback | None) -> Reply:
        if len(self.replies) >= 2:
            return Reply("There was one batch of calls, and it is used up.")
        shown = feedback and Feedback(feedback.exchanges, feedback.note, remaining=1)
        reply = await self.inner.act(shown)
        self.replies.append(reply)
        if len(self.replies) == 1:
            return reply
        answers = tuple(call for call in reply.calls if call.tool == ANSWER)
        return replace(reply, calls=answers)


def random_arguments(schema: Any, ids: list[str], source: random.Random) -> dict[str, Any]:
    """Return random arguments that fit a tool's input schema. Each optional argument is omitted half of the time."""
    required = set(schema.get("required", []))
    return {
        name: _random_value(name, field, ids, source)
        for name, field in schema.get("properties", {}).items()
        if name in required or source.random() < 0.5
    }


def _random_value(name: str, schema: Any, ids: list[str], source: random.Random) -> Any:
    if name.endswith("_id"):
        return _pick(ids, source)
    if "enum" in schema:
        return _pick(schema["enum"], source)
    if "anyOf" in schema:
        return _random_value(name, schema["anyOf"][0], ids, source)
    match schema.get("type"):
        case "array":
            value = [_random_value(name, schema["items"], ids, source) for _ in range(schema.get("minItems", 1))]
        case "boolean":
            value = source.random() < 0.5
        case "string":
            value = f"probe{int(source.random() * 1000)}"
        case _:
            low = max(schema.get("minimum", schema.get("exclusiveMinimum", -5.0)), -5.0)
            high = min(schema.get("maximum", 5.0), 5.0)
            value = low + (high - low) * max(source.random(), 1e-3)
    return value


def _pick(options: list[Any], source: random.Random) -> Any:
    return options[int(source.random() * len(options))]


def _guess(briefing: Briefing, source: random.Random) -> str | float | list[float]:
    form: dict[str, Any] = briefing.scene.get("answer") or {}
    options: list[Any] = form.get("options") or []
    if options:
        return str(_pick(options, source))
    labels: list[str] = form.get("labels") or []
    count = len(labels) if form.get("kind") == "numbers" else 0
    guesses = [_magnitude(source) for _ in range(max(1, count))]
    return guesses if count else guesses[0]


def _magnitude(source: random.Random) -> float:
    low, high = GUESS_RANGE
    return low * (high / low) ** source.random()


def _source(name: str, key: EpisodeKey) -> random.Random:
    return random.Random(f"{name}:{key.scene}:{key.seed}:{key.epoch}")  # noqa: S311 - must be reproducible, not secret
