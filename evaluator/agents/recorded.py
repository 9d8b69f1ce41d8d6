"""Replays recorded replies in a new episode. Replays, forks, films and published logs all use this module.

Callers compare the results of the calls with the record in different ways: `exchange_difference` compares within a
tolerance, `exact_difference` bit by bit, and some callers do not compare at all.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from mcp import Client
from pydantic import JsonValue

from evaluator.episode.loop import play_episode
from evaluator.episode.player import Briefing, Feedback, Player, Reply
from evaluator.episode.toolbox import Toolboxes
from evaluator.errors import AgentError, UsageError
from evaluator.records.episode import Episode, EpisodeKey, Exchange, Outcome, Turn
from evaluator.store.run_folder import RunFolder
from scenes import reference_of

_NOTHING = "(nothing)"


@dataclass(slots=True)
class RepeatingPlayer:
    """A player that replays recorded replies in order and ignores the results of its calls."""

    replies: Sequence[Reply]
    ended: str = "the stored transcript ends here"
    """Error message if the replies are used up and `go_on` is None."""
    compare: Callable[[int, Sequence[Exchange]], None] = lambda _turn, _returned: None
    """Callback before each next turn. It receives the number of the last turn, from 1, and the results of its calls."""
    go_on: Callable[[], Player] | None = None
    """Creates the player that takes over after the last recorded reply."""
    _given: int = 0
    _next: Player | None = None

    async def act(self, feedback: Feedback | None) -> Reply:
        """Return the next recorded reply, or that of the player that takes over.

        Raises:
            AgentError: The replies are used up, and no player takes over.
        """
        if self._next is not None:
            return await self._next.act(feedback)
        if feedback is not None:
            self.compare(self._given, feedback.exchanges)
        if self._given < len(self.replies):
            self._given += 1
            return self.replies[self._given - 1]
        if self.go_on is None:
            raise AgentError(self.ended)
        self._next = self.go_on()
        return await self._next.act(None)


@dataclass(frozen=True, slots=True)
class RecordedAgent:
    """Repeats the recorded calls of the episode with the same key. The record may be that of another agent."""

    name: str
    episodes: tuple[Episode, ...]

    def player(self, key: EpisodeKey, briefing: Briefing) -> RepeatingPlayer:
        """Return a player that replays the record with this key.

        Raises:
            AgentError: There is no such record, or several agents have one.
        """
        del briefing
        found = [episode for episode in self.episodes if episode.key.model_copy(update={"agent": key.agent}) == key]
        # When a run folder is replayed unchanged, the key names one of the recorded agents.
        found = [episode for episode in found if episode.key.agent == key.agent] or found
        if not found:
            raise AgentError(f"no transcript is stored for {_described(key)}")
        if len(found) > 1:
            agents = ", ".join(episode.key.agent for episode in found)
            raise AgentError(f"{len(found)} transcripts are stored for {_described(key)}, of {agents}")
        return RepeatingPlayer(replies_of(found[0].turns))


def replies_of(turns: Iterable[Turn]) -> list[Reply]:
    """Convert turns to replies. A malformed reply has no calls, because its record holds none."""
    return [Reply(turn.reasoning, tuple(exchange.call for exchange in turn.exchanges)) for turn in turns]


def load_recorded(folder: Path) -> RecordedAgent:
    """Load the agent that replays the records of a run folder.

    Raises:
        UsageError: The folder holds no played episode.
        StoreError: A record is damaged.
    """
    stored = RunFolder(folder).episodes().values()
    episodes = tuple(episode for episode in stored if episode.outcome is not Outcome.INFRASTRUCTURE_ERROR)
    if not episodes:
        raise UsageError(f"{folder} holds no transcript to replay")
    return RecordedAgent(f"replay:{folder.name}", episodes)


async def play_again(stored: Episode, client: Client, toolboxes: Toolboxes | None) -> Episode:
    """Play an episode again with the recorded calls and the recorded number of turns.

    Args:
        stored: The record.
        client: A client connected to a fresh session of its scene and seed.
        toolboxes: As for `play_episode`.

    Raises:
        InfrastructureError: The server failed.
    """
    # The prompt of an external agent states a number of calls, and each of its calls is a turn.
    by_itself = stored.max_calls is not None
    budget = max(stored.allowance, len(stored.turns)) if by_itself else stored.key.budget
    key = stored.key.model_copy(update={"budget": budget})
    agent = RecordedAgent(stored.key.agent, (stored.model_copy(update={"key": key}),))
    now = await play_episode(agent, client, key, stored.versions, toolboxes)
    return now.model_copy(update={"key": stored.key, **({"prompt": stored.prompt} if by_itself else {})})


def exchange_difference(before: Exchange, after: Exchange, rel_tol: float) -> tuple[str, JsonValue, JsonValue] | None:
    """Return path, earlier and later value of the first difference between two results of a call; None if equal."""
    kinds = [_kind(exchange) for exchange in (before, after)]
    if kinds[0] != kinds[1]:
        return "", f"{kinds[0]}: {before.text}", f"{kinds[1]}: {after.text}"
    if before.is_error:
        return None if before.text == after.text else ("", before.text, after.text)
    return next(different_values(before.content, after.content, rel_tol, ""), None)


def exact_difference(before: Exchange, after: Exchange) -> tuple[str, JsonValue, JsonValue] | None:
    """Like `exchange_difference`, but without tolerance and including the text of the result."""
    found = exchange_difference(before, after, 0.0)
    if found is None and before.text != after.text:
        return "text", before.text, after.text
    return found


def different_values(
    old: JsonValue, new: JsonValue, rel_tol: float, path: str
) -> Iterator[tuple[str, JsonValue, JsonValue]]:
    """Yield path and both values of every difference between two JSON values.

    Args:
        old: The earlier value.
        new: The later value.
        rel_tol: Relative tolerance for numbers, as in `math.isclose`.
        path: Path of the two values; empty for a whole document.
    """
    if isinstance(old, dict) and isinstance(new, dict):
        for name in dict.fromkeys((*old, *new)):
            inner = f"{path}.{name}" if path else name
            yield from different_values(old.get(name, _NOTHING), new.get(name, _NOTHING), rel_tol, inner)
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for index, (old_item, new_item) in enumerate(zip(old, new, strict=True)):
            yield from different_values(old_item, new_item, rel_tol, f"{path}[{index}]")
    elif _is_number(old) and _is_number(new):
        assert isinstance(old, int | float)
        assert isinstance(new, int | float)
        if not math.isclose(old, new, rel_tol=rel_tol):
            yield path, old, new
    elif type(old) is not type(new) or old != new:
        yield path, old, new


def _is_number(value: JsonValue) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _kind(exchange: Exchange) -> str:
    ran = "returned" if exchange.returned else "not run"
    return f"{ran}, an error" if exchange.is_error else ran


def _described(key: EpisodeKey) -> str:
    return (
        f"scene {reference_of(key.scene)}, seed {key.seed}, budget {key.budget}, {key.prompting}, {key.protocol},"
        f" epoch {key.epoch}"
    )
