"""Replay: the calls of recorded episodes are repeated, and their results are compared with the record.

If the tool contract has not changed since the recording, every field must be equal. Otherwise every recorded field must
be equal; fields that the record lacks and changed opening prompts are counted and not reported as differences.
"""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

import anyio
from pydantic import JsonValue

from evaluator.agents.recorded import RecordedAgent, exchange_difference, play_again
from evaluator.episode.connect import EpisodeConnector
from evaluator.errors import InfrastructureError
from evaluator.records.episode import Episode, EpisodeKey, Exchange, Outcome, Record
from evaluator.study.run_start import server_record

REL_TOL = 1e-9
"""Largest difference between numbers that count as equal, relative to the larger one."""


class Difference(Record):
    """A location at which a replay differs from the record."""

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
    """The result of replaying one episode."""

    key: EpisodeKey
    calls: int = 0
    """Calls compared."""
    differences: tuple[Difference, ...] = ()
    added: Mapping[str, int] = field(default_factory=dict[str, int])
    """Number of occurrences of each addition that the record lacks. A key is a tool and a field, such as
    `get_velocity: speed`, or the opening prompt."""
    failure: str = ""
    """Why the episode could not be played; empty if it was."""


async def replay(
    agent: RecordedAgent,
    laboratory: EpisodeConnector,
    *,
    contracts: frozenset[str] = frozenset(),
    rel_tol: float = REL_TOL,
    concurrency: int = 1,
    on_end: Callable[[Replayed], None] = lambda _: None,
) -> list[Replayed]:
    """Replay all episodes of an agent.

    Args:
        agent: The recorded episodes.
        laboratory: Connector to the laboratory on which the episodes are replayed.
        contracts: Hashes of the tool contracts that the episodes were recorded under. If it is empty or holds only the
            present contract, every field must be equal.
        rel_tol: Largest difference between numbers that count as equal, relative to the larger one; 0 for none.
        concurrency: Number of episodes played at a time.
        on_end: Called after each episode.

    Returns:
        The result of each episode, in the order of the record.
    """
    results: dict[EpisodeKey, Replayed] = {}
    waiting = iter(agent.episodes)

    async def worker() -> None:
        for stored in waiting:
            results[stored.key] = await _replay_episode(laboratory, stored, contracts, rel_tol)
            on_end(results[stored.key])

    async with anyio.create_task_group() as tasks:
        for _ in range(min(concurrency, len(agent.episodes))):
            tasks.start_soon(worker)
    return [results[episode.key] for episode in agent.episodes]


async def _replay_episode(
    laboratory: EpisodeConnector, stored: Episode, contracts: frozenset[str], rel_tol: float
) -> Replayed:
    try:
        async with laboratory.open(stored.key.scene, stored.key.seed) as client:
            present = (await server_record(client, option="")).tool_schema_hash
            now = await play_again(stored, client, laboratory.toolboxes)
    except InfrastructureError as error:
        return Replayed(stored.key, failure=str(error))
    calls = sum(exchange.returned for turn in stored.turns for exchange in turn.exchanges)
    added = Counter[str]()
    if not contracts <= {present}:
        now, added = without_added(stored, now)
    return Replayed(stored.key, calls, tuple(differences(stored, now, rel_tol)), added)


def without_added(stored: Episode, now: Episode) -> tuple[Episode, Counter[str]]:
    """Remove from a replayed episode the fields that its record lacks, and count them.

    The opening prompt describes the tools, so it may change with the tool contract. A changed prompt is counted too.
    """
    added = Counter[str]()
    if now.prompt != stored.prompt:
        added["opening prompt"] += 1

    def recorded(before: Exchange, after: Exchange) -> Exchange:
        content = _recorded_part(before.content, after.content, f"{before.call.tool}: ", added)
        return after.model_copy(update={"content": content})

    turns = [
        after.model_copy(update={"exchanges": tuple(map(recorded, before.exchanges, after.exchanges))})
        for before, after in zip(stored.turns, now.turns, strict=False)
    ]
    return now.model_copy(update={"turns": tuple(turns), "prompt": stored.prompt}), added


def _recorded_part(old: JsonValue, new: JsonValue, path: str, added: Counter[str]) -> JsonValue:
    """Restrict a replayed value to the fields of the recorded one; adds the removed fields to `added`."""
    if isinstance(old, dict) and isinstance(new, dict):
        added.update(f"{path}{name}" for name in new if name not in old)
        return {
            name: _recorded_part(old[name], value, f"{path}{name}.", added)
            for name, value in new.items()
            if name in old
        }
    if isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        return [_recorded_part(before, after, path, added) for before, after in zip(old, new, strict=True)]
    return new


def differences(stored: Episode, now: Episode, rel_tol: float = REL_TOL) -> Iterator[Difference]:
    """Yield the differences between a stored and a replayed episode, at most one for each call.

    Times, notes and usage do not come from the laboratory and are not compared.
    """
    key = stored.key
    if stored.prompt != now.prompt:
        yield Difference(key=key, turn=0, call=0, what="opening prompt", stored=stored.prompt, now=now.prompt)
    for number, turn in enumerate(stored.turns, start=1):
        if number > len(now.turns):
            yield Difference(key=key, turn=number, call=0, what="turn", stored="played", now="not played")
            return
        again = now.turns[number - 1].exchanges
        if len(again) != len(turn.exchanges):  # the reply is now refused as a whole, for example because it is too long
            counts = [f"{len(made)} call{'s' * (len(made) != 1)}" for made in (turn.exchanges, again)]
            yield Difference(key=key, turn=number, call=0, what="turn", stored=counts[0], now=counts[1])
            return
        for index, (before, after) in enumerate(zip(turn.exchanges, again, strict=True), start=1):
            found = exchange_difference(before, after, rel_tol)
            if found is not None:
                path, old, new = found
                what = f"{before.call.tool}: {path}" if path else before.call.tool
                yield Difference(key=key, turn=number, call=index, what=what, stored=old, now=new)
    answered = [episode.outcome is Outcome.ANSWERED for episode in (stored, now)]
    if answered[0] != answered[1]:
        words = ["answered" if ended else "not answered" for ended in answered]
        yield Difference(key=key, turn=0, call=0, what="outcome", stored=words[0], now=words[1])
    elif stored.answer != now.answer:
        # Grading reads the recorded answer, so it must equal the argument of the recorded `answer` call.
        yield Difference(key=key, turn=0, call=0, what="answer", stored=stored.answer, now=now.answer)
