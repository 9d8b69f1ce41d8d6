"""Tests of the loop with the real laboratory in memory, and agents with given turns."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import mcp_types as types
import pytest
from mcp import Client, MCPError
from mcp.server.lowlevel import Server

from evaluator.agents.reference import ScriptedAgent
from evaluator.episode.loop import opening_prompt, play_episode
from evaluator.episode.player import Agent, Briefing, Feedback, Reply
from evaluator.episode.protocols.text import feedback_text, parse_reply
from evaluator.errors import AgentError, InfrastructureError
from evaluator.records.episode import Episode, EpisodeKey, Outcome, ToolCall, Usage
from physment_mcp import open_episode
from tests.builders.records import ANSWER, LOOK, STEP, VERSIONS, answer, call, episode_key


@dataclass
class Replies:
    """An agent that returns given replies and stores the feedback."""

    replies: Sequence[Reply | Exception]
    seen: list[Feedback | None] = field(default_factory=list[Feedback | None])
    name: str = "replies"

    def player(self, key: EpisodeKey, briefing: Briefing) -> "Replies":
        return self

    async def act(self, feedback: Feedback | None) -> Reply:
        self.seen.append(feedback)
        reply = self.replies[len(self.seen) - 1] if len(self.seen) <= len(self.replies) else Reply()
        if isinstance(reply, Exception):
            raise reply
        return reply


async def play(agent: Agent, budget: int = 5) -> Episode:
    async with Client(open_episode(7).server()) as client:
        return await play_episode(agent, client, episode_key(budget=budget), VERSIONS)


def script(*turns: tuple[ToolCall, ...]) -> ScriptedAgent:
    return ScriptedAgent("script", {None: turns})


@pytest.mark.parametrize("value", [7.848, "7.848 m/s", [1, "a", 2.5], "", 0, -1e-9])
async def test_the_answer_is_recorded_verbatim(value: object) -> None:
    episode = await play(script((STEP, answer(value))))
    assert (episode.outcome, episode.answer) == (Outcome.ANSWERED, value)


async def test_calls_after_the_answer_are_not_run() -> None:
    episode = await play(script((ANSWER, STEP, answer(2))))
    assert episode.answer == 1
    assert [exchange.returned for exchange in episode.turns[0].exchanges] == [True, False, False]


async def test_an_answer_that_the_laboratory_refuses_does_not_end_the_episode() -> None:
    too_long = answer("x" * 20_000)
    episode = await play(script((too_long, STEP), (answer(3),)))
    assert (episode.answer, len(episode.turns)) == (3, 2)


async def test_a_call_that_does_not_fit_its_schema_stops_the_batch_and_earlier_calls_count() -> None:
    agent = Replies([Reply(calls=(STEP, call("step", duration="long"), STEP)), Reply(calls=(LOOK, ANSWER))])
    episode = await play(agent)
    first = episode.turns[0]
    assert [(exchange.returned, exchange.is_error) for exchange in first.exchanges] == [
        (True, False),
        (False, True),
        (False, False),
    ]
    assert "duration" in first.note
    assert episode.turns[1].exchanges[0].content is not None
    assert episode.turns[1].exchanges[0].content["sim_time"] == pytest.approx(0.1)


@pytest.mark.parametrize(
    "misfit",
    [
        call("fly"),
        call("step", duration=math.nan),
        call("step", duration=math.inf),
        call("step", duration=0.1, hurry=True),
        call("step"),
        call("set_velocity", object_id="object_1", velocity_vector=[1, 2]),
        call("apply_force", object_id="object_1", force_vector=[1, 2, True]),
    ],
    ids=str,
)
async def test_a_call_that_does_not_fit_its_schema_is_never_run(misfit: ToolCall) -> None:
    episode = await play(script((misfit,), (ANSWER,)))
    (exchange,) = episode.turns[0].exchanges
    assert (exchange.returned, exchange.is_error) == (False, True)
    assert exchange.text


async def test_a_refusal_by_the_laboratory_does_not_stop_the_batch() -> None:
    episode = await play(script((call("get_position", object_id="object_9"), STEP, ANSWER)))
    assert [(exchange.returned, exchange.is_error) for exchange in episode.turns[0].exchanges] == [
        (True, True),
        (True, False),
        (True, False),
    ]


async def test_a_reply_without_calls_and_an_unreadable_reply_cost_an_iteration_each() -> None:
    agent = Replies([Reply("thinking"), Reply(calls=(), malformed="no list of calls"), Reply(calls=(ANSWER,))])
    episode = await play(agent)
    assert len(episode.turns) == 3
    assert "no tool call" in episode.turns[0].note
    assert "no list of calls" in episode.turns[1].note
    assert [turn.is_unread for turn in episode.turns] == [False, True, False]


async def test_of_two_lists_in_a_reply_none_is_run_and_the_agent_reads_why() -> None:
    lists = (
        '[{"tool": "step", "parameters": {"duration": 1}}]\n\nThen: [{"tool": "answer", "parameters": {"answer": 1}}]'
    )
    agent = Replies([parse_reply(lists), Reply(calls=(LOOK,)), Reply(calls=(ANSWER,))])
    episode = await play(agent)
    assert (episode.turns[0].exchanges, episode.turns[0].is_unread) == ((), True)
    assert agent.seen[1] is not None
    assert "2 sets of calls" in feedback_text(agent.seen[1])
    content = episode.turns[1].exchanges[0].content
    assert content is not None
    assert content["sim_time"] == 0


@pytest.mark.parametrize("protocol", ["native", "text"])
async def test_the_prompt_states_which_calls_of_a_reply_are_run(protocol: str) -> None:
    """Checks only the text. `test_a_call_that_does_not_fit_its_schema_stops_the_batch…` tests that the loop does so."""
    async with Client(open_episode(7).server()) as client:
        key = episode_key(protocol=protocol)
        prompt = await opening_prompt(client, key, 5)
        assert prompt.count("A call that fits no tool ends them: the calls before it stand") == 1
        assert prompt.count("A call that the laboratory refuses does not end them") == 1


async def test_the_agent_learns_how_many_iterations_are_left() -> None:
    agent = Replies([Reply(calls=(STEP,))] * 3)
    episode = await play(agent, budget=3)
    assert [feedback.remaining for feedback in agent.seen if feedback] == [2, 1]
    assert (episode.outcome, episode.answer, len(episode.turns)) == (Outcome.BUDGET_EXHAUSTED, None, 3)
    assert "You have 3 iterations" in episode.prompt


async def test_an_answer_after_the_last_iteration_does_not_count() -> None:
    episode = await play(script((STEP,), (STEP,), (answer(7.848),)), budget=2)
    assert (episode.outcome, episode.answer) == (Outcome.BUDGET_EXHAUSTED, None)


async def test_an_agent_that_cannot_continue_is_recorded_with_its_reason_and_its_turns() -> None:
    episode = await play(Replies([Reply(calls=(STEP,)), AgentError("the context is full")]))
    assert (episode.outcome, episode.error, len(episode.turns)) == (Outcome.AGENT_ERROR, "the context is full", 1)


async def test_the_agent_reads_exactly_the_text_that_the_laboratory_returned() -> None:
    agent = Replies([Reply(calls=(STEP, LOOK)), Reply(calls=(ANSWER,))])
    await play(agent)
    (feedback,) = [feedback for feedback in agent.seen if feedback]
    assert feedback.exchanges[0].text.startswith('{"sim_time":0.1')
    assert feedback.exchanges[1].content is not None
    assert feedback.exchanges[1].content["position"][2] < 30


async def _no_tools(_ctx: object, _params: object) -> types.ListToolsResult:
    tools = [types.Tool(name=name, input_schema={"type": "object"}) for name in ("step", "answer")]
    return types.ListToolsResult(tools=tools)


async def _short_prompt(_ctx: object, _params: object) -> types.GetPromptResult:
    text = types.TextContent(type="text", text="task")
    return types.GetPromptResult(messages=[types.PromptMessage(role="user", content=text)])


async def test_a_server_needs_no_scene_resource_and_its_failure_is_not_an_agent_error() -> None:
    async def call_tool(_ctx: object, params: types.CallToolRequestParams) -> types.CallToolResult:
        if params.name == "step":
            raise MCPError(types.INTERNAL_ERROR, "broken")
        return types.CallToolResult(content=[types.TextContent(type="text", text="{}")], structured_content={})

    server: Server[object] = Server("x", on_list_tools=_no_tools, on_call_tool=call_tool, on_get_prompt=_short_prompt)
    key = episode_key(budget=5)
    async with Client(server) as client:
        episode = await play_episode(script((ANSWER,)), client, key, VERSIONS)
        assert (episode.prompt, episode.answer) == ("task", 1)
        with pytest.raises(InfrastructureError, match="step did not return"):
            await play_episode(script((STEP,)), client, key, VERSIONS)


async def test_usage_is_added_up_and_an_unknown_cost_stays_unknown() -> None:
    tokens = Usage(input_tokens=10, output_tokens=3, cached_tokens=1)
    priced = tokens.model_copy(update={"cost_usd": 0.25})
    both = await play(Replies([Reply(calls=(STEP,), usage=tokens), Reply(calls=(ANSWER,), usage=priced)]))
    assert both.usage == Usage(input_tokens=20, output_tokens=6, cached_tokens=2, cost_usd=0.25)
    failed = await play(Replies([Reply(calls=(STEP,), usage=tokens), AgentError("the context is full", priced)]))
    assert failed.usage == both.usage
    unpriced = await play(Replies([Reply(calls=(ANSWER,), usage=tokens)]))
    assert unpriced.usage is not None
    assert unpriced.usage.cost_usd is None
