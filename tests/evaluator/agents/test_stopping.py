"""Tests of stopping policies: when they give advice, what they advise, and that they change nothing else."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import pytest
from mcp import Client

from evaluator.agents.reference import ScriptedAgent
from evaluator.agents.stopping import stated_confidence, with_stopping
from evaluator.episode.loop import play_episode
from evaluator.episode.player import Briefing, Feedback, Reply
from evaluator.errors import UsageError
from evaluator.records.episode import Episode, EpisodeKey, Outcome
from physment_mcp import open_episode
from tests.builders.records import ANSWER, STEP, VERSIONS, episode_key

ASKED = "In the reasoning of your next reply, state how confident"


@dataclass
class Replies:
    """An agent that returns given replies and stores the feedback."""

    replies: Sequence[Reply]
    seen: list[Feedback | None] = field(default_factory=list[Feedback | None])
    name: str = "replies"

    def player(self, key: EpisodeKey, briefing: Briefing) -> "Replies":
        return self

    async def act(self, feedback: Feedback | None) -> Reply:
        self.seen.append(feedback)
        return self.replies[len(self.seen) - 1]

    @property
    def notes(self) -> list[str]:
        return [feedback.note for feedback in self.seen if feedback]


async def play(agent: Replies | ScriptedAgent, policy: str, budget: int) -> Episode:
    playing = with_stopping(agent, policy)
    key = episode_key(agent=playing.name, budget=budget)
    async with Client(open_episode(7).server()) as client:
        return await play_episode(playing, client, key, VERSIONS)


async def test_budget_aware_asks_for_the_answer_only_in_the_last_two_iterations() -> None:
    agent = Replies([Reply(calls=(STEP,))] * 4)
    episode = await play(agent, "budget-aware", budget=4)
    assert [bool(note) for note in agent.notes] == [False, True, True]
    assert agent.notes[1:] == [
        "2 iterations are left: call answer now, with the best value you have.",
        "This is your last iteration: call answer now, with the best value you have.",
    ]
    assert (episode.outcome, len(episode.turns)) == (Outcome.BUDGET_EXHAUSTED, 4)


async def test_confidence_asks_for_a_confidence_and_above_the_threshold_for_the_answer() -> None:
    stated = ["", "Confidence: 0.89", "confidence: 0.95", "no idea any more", ""]
    agent = Replies([Reply(text, (STEP,)) for text in stated])
    await play(agent, "confidence", budget=5)
    assert [note.startswith(ASKED) for note in agent.notes] == [True, True, False, True]
    assert agent.notes[2] == "You stated a confidence of 0.95: call answer now."


async def test_the_operator_sets_the_threshold() -> None:
    agent = Replies([Reply("confidence: 0.5", (STEP,)), Reply("", (ANSWER,))])
    await play(agent, "confidence:0.5", budget=3)
    assert agent.notes == ["You stated a confidence of 0.5: call answer now."]


async def test_always_does_not_change_the_agent() -> None:
    agent = Replies([])
    assert with_stopping(agent, "always") is agent


async def test_the_note_of_the_loop_comes_before_the_advice() -> None:
    agent = Replies([Reply("thinking"), Reply(calls=(ANSWER,))])
    await play(agent, "budget-aware", budget=2)
    assert agent.notes == [
        "Your reply held no tool call.\n"
        "This is your last iteration: call answer now, with the best value you have."
    ]  # fmt: skip


@pytest.mark.parametrize("policy", ["budget-aware", "confidence", "confidence:0.25"])
async def test_a_policy_changes_neither_calls_nor_outcome_nor_remaining_iterations(policy: str) -> None:
    script = ((STEP, STEP), (), (STEP,), (ANSWER,))
    plain, under = [
        await play(ScriptedAgent("script", {None: script}), stopping, budget=5) for stopping in ("always", policy)
    ]
    assert under.key.agent == f"script+{policy if ':' in policy or policy == 'budget-aware' else 'confidence:0.9'}"
    assert [
        (turn.reasoning, turn.note, [(exchange.call, exchange.content) for exchange in turn.exchanges])
        for turn in under.turns
    ] == [
        (turn.reasoning, turn.note, [(exchange.call, exchange.content) for exchange in turn.exchanges])
        for turn in plain.turns
    ]
    assert (under.outcome, under.answer, under.prompt) == (plain.outcome, plain.answer, plain.prompt)


@pytest.mark.parametrize(
    ("text", "confidence"),
    [
        ("confidence: 0.5", 0.5),
        ("Confidence = .75.", 0.75),
        ("My confidence is now 0.9, so I go on", 0.9),
        ("**Confidence:** 1", 1.0),
        ("**confidence**: 0", 0.0),
        ("confidence level of about 80%", 0.8),
        ("confidence (0-1): 0.7", 0.7),
        ("Confidence (0 to 1) is 0.7", 0.7),
        ("a confidence of 0 to 1", None),
        ("confidence: 1/10", None),
        ("confidence: 1 out of 10", None),
        ("confidence 0.51-0.6", None),
        ("95 % confidence interval: 0.8", None),
        ("confidence: 0.2 at first, then confidence: 0.6", 0.6),
        ("confidence: 7", None),
        ("confidence: 0.4 ... confidence: 12", 0.4),
        ("confidence: 95", None),
        ("confidence: 100 %", 1.0),
        ("confidence: 0.5.1", None),
        ("confident 0.5", None),
        ("I have no confidence in 0.5", None),
        ("", None),
    ],
)
def test_only_a_stated_confidence_is_read_as_one(text: str, confidence: float | None) -> None:
    assert stated_confidence(text) == (None if confidence is None else pytest.approx(confidence))


@pytest.mark.parametrize(
    "text",
    ["", "never", "always:1", "budget-aware:2"] + [f"confidence:{rest}" for rest in ("", "0", "1.1", "nan", "high")],
)
def test_an_unknown_or_malformed_policy_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="--stopping"):
        with_stopping(Replies([]), text)
