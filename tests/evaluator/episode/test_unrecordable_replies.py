"""Tests that replies that cannot be recorded count as malformed: they use an iteration and do not harm the run."""

from pathlib import Path
from typing import Any

import pytest
from mcp import Client

from evaluator.episode.loop import play_episode
from evaluator.episode.player import Briefing, Feedback, Reply
from evaluator.errors import AgentError
from evaluator.records.episode import Episode, EpisodeKey, Outcome, ToolCall
from evaluator.store.run_folder import RunFolder
from physment_mcp import open_episode
from tests.builders.records import ANSWER, STEP, VERSIONS, answer, call, episode_key


class Saying:
    """An agent that gives one reply, and then answers 1."""

    name = "saying"

    def __init__(self, reply: Reply | Exception) -> None:
        self.replies = [reply, Reply(calls=(ANSWER,))]

    def player(self, key: EpisodeKey, briefing: Briefing) -> "Saying":
        return self

    async def act(self, feedback: Feedback | None) -> Reply:
        reply = self.replies.pop(0)
        if isinstance(reply, Exception):
            raise reply
        return reply


def nested(levels: int) -> Any:
    value: Any = 1
    for _ in range(levels):
        value = [value]
    return value


async def stored(reply: Reply | Exception, path: Path) -> Episode:
    """Play, store, and read the record back."""
    folder = RunFolder(path / "run")
    folder.create(resume=False)
    key = episode_key(budget=3)
    async with Client(open_episode(7).server()) as client:
        episode = await play_episode(Saying(reply), client, key, VERSIONS)
    folder.append_episode(episode)
    assert list(folder.episodes().values()) == [episode]
    return episode


@pytest.mark.parametrize(
    ("bad", "problem"),
    [
        (answer("\ud800"), "half a surrogate pair"),
        (call("step", **{"\udfff": 1}), "half a surrogate pair"),
        (call("st\ud800ep"), "half a surrogate pair"),
        (answer(nested(64)), "nests more than 64 levels"),
        (answer(nested(220)), "nests more than 64 levels"),
        (answer(nested(5000)), "nests more than 64 levels"),
        (call("no such tool", a={"b": nested(300)}), "nests more than 64 levels"),
        (answer(object()), "is not JSON"),
        (answer(10**5000), "is not JSON"),
    ],
    ids=[
        "value",
        "name of an argument",
        "name of a tool",
        "65 levels",
        "220 levels",
        "5000 levels",
        "unknown tool",
        "object",
        "digits",
    ],
)
async def test_a_call_that_no_record_can_hold_is_not_run_and_costs_an_iteration(
    bad: ToolCall, problem: str, tmp_path: Path
) -> None:
    episode = await stored(Reply("I try.", (STEP, bad)), tmp_path)
    assert episode.turns[0].exchanges == ()
    assert problem in episode.turns[0].note
    assert (episode.outcome, episode.answer, len(episode.turns)) == (Outcome.ANSWERED, 1, 2)


async def test_reasoning_that_utf_8_cannot_encode_is_repaired_and_its_calls_run(tmp_path: Path) -> None:
    episode = await stored(Reply("so \ud83d and \U0001f600", (answer("ä\u2028\U0001f600"),)), tmp_path)
    assert episode.turns[0].reasoning == "so ? and \U0001f600"
    assert episode.answer == "ä\u2028\U0001f600"


async def test_the_reasons_of_a_malformed_reply_and_of_an_agent_error_are_repaired_too(tmp_path: Path) -> None:
    malformed = await stored(Reply(malformed="no list in \ud800"), tmp_path / "one")
    assert malformed.turns[0].note.endswith("no list in ?")
    ended = await stored(AgentError("refused: \ud800"), tmp_path / "two")
    assert (ended.outcome, ended.error) == (Outcome.AGENT_ERROR, "refused: ?")


async def test_nested_lists_within_the_limit_are_left_to_the_schema_of_the_tool(tmp_path: Path) -> None:
    episode = await stored(Reply(calls=(answer(nested(62)),)), tmp_path)
    (exchange,) = episode.turns[0].exchanges
    assert (exchange.returned, exchange.is_error) == (False, True)
