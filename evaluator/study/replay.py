"""Whether a laboratory still returns what it returned: stored episodes played again and compared, value by value."""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import anyio
from pydantic import JsonValue

from evaluator.agents.replay import ReplayAgent
from evaluator.episode.connect import Laboratory
from evaluator.episode.loop import play_episode
from evaluator.errors import InfrastructureError
from evaluator.records import Episode, EpisodeKey, Exchange, Outcome, Record

REL_TOL = 1e-9
"""How far two numbers may be apart, as a share of the larger, and still be the same."""
_NOTHING = "(nothing)"


class Difference(Record):
    """One place where a replay went another way than the record."""

    key: EpisodeKey
    turn: int
    """Number of the turn, from 1; 0 for the episode as a whole."""
    call: int
    """Number of the call in its turn, from 1; 0 for the turn as a whole."""
    what: str
    """The tool and the part of its result, such as `get_velocity: velocity[2]`."""
    stored: JsonValue
    now: JsonValue


@dataclass(frozen=True, slots=True)
class Replayed:
    """What came of one stored episode."""

    key: EpisodeKey
    calls: int = 0
    """Calls compared."""
    differences: tuple[Difference, ...] = ()
    failure: str = ""
    """Why the episode could not be played, if so."""


async def replay(
    agent: ReplayAgent,
    laboratory: Laboratory,
    *,
    rel_tol: float = REL_TOL,
    concurrency: int = 1,
    on_end: Callable[[Replayed], None] = lambda _: None,
) -> list[Replayed]:
    """Play all transcripts of an agent again.

    Args:
        agent: The transcripts.
        laboratory: Where to play.
        rel_tol: How far numbers may be apart, relative to the larger; 0 for exactly the same.
        concurrency: Episodes played at a time.
        on_end: Told of each episode when it is through.

    Returns:
        What came of each, in stored order.
    """
    results: dict[EpisodeKey, Replayed] = {}
    waiting = iter(agent.episodes)

    async def worker() -> None:
        for stored in waiting:
            results[stored.key] = await _replay_one(agent, laboratory, stored, rel_tol)
            on_end(results[stored.key])

    async with anyio.create_task_group() as tasks:
        for _ in range(min(concurrency, len(agent.episodes))):
            tasks.start_soon(worker)
    return [results[one.key] for one in agent.episodes]


async def _replay_one(agent: ReplayAgent, laboratory: Laboratory, stored: Episode, rel_tol: float) -> Replayed:
    try:
        async with laboratory.open(stored.key.scene, stored.key.seed) as client:
            now = await play_episode(agent, client, stored.key, stored.versions, laboratory.toolboxes)
    except InfrastructureError as error:
        return Replayed(stored.key, failure=str(error))
    calls = sum(one.returned for turn in stored.turns for one in turn.exchanges)
    return Replayed(stored.key, calls, tuple(differences(stored, now, rel_tol)))


def differences(stored: Episode, now: Episode, rel_tol: float = REL_TOL) -> Iterator[Difference]:
    """All places where two plays of the same calls differ; the first of each call only.

    Times, notes and usage are no part of what the laboratory returned, and are not compared.
    """
    key = stored.key
    if stored.prompt != now.prompt:
        yield Difference(key=key, turn=0, call=0, what="opening prompt", stored=stored.prompt, now=now.prompt)
    for number, turn in enumerate(stored.turns, start=1):
        if number > len(now.turns):
            yield Difference(key=key, turn=number, call=0, what="turn", stored="played", now="not played")
            return
        for index, (before, after) in enumerate(
            zip(turn.exchanges, now.turns[number - 1].exchanges, strict=True), start=1
        ):
            found = _unlike(before, after, rel_tol)
            if found is not None:
                path, old, new = found
                what = f"{before.call.tool}: {path}" if path else before.call.tool
                yield Difference(key=key, turn=number, call=index, what=what, stored=old, now=new)
    ends = [one.outcome is Outcome.ANSWERED for one in (stored, now)]
    if ends[0] != ends[1]:
        told = ["answered" if end else "not answered" for end in ends]
        yield Difference(key=key, turn=0, call=0, what="outcome", stored=told[0], now=told[1])


def _unlike(before: Exchange, after: Exchange, rel_tol: float) -> tuple[str, JsonValue, JsonValue] | None:
    """The first difference between what two runs of a call brought; None if there is none."""
    kinds = [_kind(one) for one in (before, after)]
    if kinds[0] != kinds[1]:
        return "", f"{kinds[0]}: {before.text}", f"{kinds[1]}: {after.text}"
    if before.is_error:
        return None if before.text == after.text else ("", before.text, after.text)
    return next(_unlike_values(before.content, after.content, rel_tol, ""), None)


def _kind(exchange: Exchange) -> str:
    ran = "returned" if exchange.returned else "not run"
    return f"{ran}, an error" if exchange.is_error else ran


def _unlike_values(
    old: JsonValue, new: JsonValue, rel_tol: float, path: str
) -> Iterator[tuple[str, JsonValue, JsonValue]]:
    if isinstance(old, dict) and isinstance(new, dict):
        for name in _both(old, new):
            inner = f"{path}.{name}" if path else name
            yield from _unlike_values(old.get(name, _NOTHING), new.get(name, _NOTHING), rel_tol, inner)
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for index, (one, other) in enumerate(zip(old, new, strict=True)):
            yield from _unlike_values(one, other, rel_tol, f"{path}[{index}]")
    elif _is_number(old) and _is_number(new):
        assert isinstance(old, int | float)
        assert isinstance(new, int | float)
        if not math.isclose(old, new, rel_tol=rel_tol):
            yield path, old, new
    elif type(old) is not type(new) or old != new:
        yield path, old, new


def _both(old: Iterable[str], new: Iterable[str]) -> dict[str, None]:
    """The names of either, in order."""
    return dict.fromkeys((*old, *new))


def _is_number(value: JsonValue) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
