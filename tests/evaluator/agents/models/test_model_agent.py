"""Tests of whole episodes with real provider clients, against loopback servers that implement their wire formats."""

import json
from typing import Any

import pytest
from mcp import Client

from evaluator.agents.baselines import OracleOnceAgent
from evaluator.agents.models.agent import ModelAgent
from evaluator.agents.models.choice import parse_model
from evaluator.episode.loop import play_episode
from evaluator.errors import PermanentFailure
from evaluator.records.episode import Episode, Outcome, Usage
from physment_mcp import open_episode
from tests.builders.providers import Say, Service
from tests.builders.records import VERSIONS, episode_key

STEP = ("step", {"duration": 0.8})
LOOK = ("get_velocity", {"object_id": "object_1"})


async def play(service: Service, *, budget: int = 5, protocol: str = "native", options: str = "") -> Episode:
    """Play scene 7 at a provider."""
    text = f"model:{service.dialect.name}:{service.dialect.model}{options}"
    key = episode_key(agent=text, budget=budget, protocol=protocol)
    async with (
        ModelAgent(parse_model(text, environ=service.environ)) as agent,
        Client(open_episode(7).server()) as client,
    ):
        return await play_episode(agent, client, key, VERSIONS)


def speed(returned: str) -> float:
    return abs(json.loads(returned)["velocity"][2])


def written(*calls: tuple[str, Any]) -> str:
    """Calls in the text protocol."""
    return f"```json\n{json.dumps([{'tool': tool, 'parameters': given} for tool, given in calls])}\n```"


async def test_an_episode_with_native_calls_ends_with_the_right_answer(service: Service) -> None:
    service.say("I let it fall, then look.", [STEP, LOOK], thought="v = g t")
    service.compute(lambda seen: Say("It fell.", [("answer", {"answer": speed(seen.returns[1])})]))
    episode = await play(service)
    assert (episode.outcome, episode.answer) == (Outcome.ANSWERED, pytest.approx(7.848, rel=1e-3))
    first = episode.turns[0]
    assert [exchange.call.tool for exchange in first.exchanges] == ["step", "get_velocity"]
    assert first.reasoning == "v = g t\n\nI let it fall, then look."
    assert [turn.reasoning[: turn.thought_chars] for turn in episode.turns] == ["v = g t", ""]
    # The model received exactly the recorded text.
    assert service.seen[1].returns == [exchange.text for exchange in first.exchanges]


async def test_an_episode_in_the_text_protocol_ends_with_the_right_answer(service: Service) -> None:
    def answer(seen: Any) -> Any:
        returned = next(line for line in seen.last.splitlines() if "get_velocity(" in line)
        return Say(f"Read.\n{written(('answer', {'answer': speed(returned.split('-> ', 1)[1])}))}")

    service.say(f"I let it fall.\n{written(STEP, LOOK)}", thought="v = g t")
    service.compute(answer)
    episode = await play(service, protocol="text")
    assert (episode.outcome, episode.answer) == (Outcome.ANSWERED, pytest.approx(7.848, rel=1e-3))
    assert episode.turns[0].reasoning == "v = g t\n\nI let it fall."
    assert episode.turns[0].thought_chars == len("v = g t")
    assert not any(seen.body.get("tools") for seen in service.seen)


async def test_tool_schemas_are_sent_as_the_server_published_them(openai: Service, anthropic: Service) -> None:
    async with Client(open_episode(7).server()) as client:
        published = {tool.name: tool.input_schema for tool in (await client.list_tools()).tools}
    for service in (openai, anthropic):
        service.say("", [("answer", {"answer": 1})])
        await play(service)
    sent = {tool["function"]["name"]: tool["function"]["parameters"] for tool in openai.seen[0].body["tools"]}
    assert sent == published
    assert {tool["name"]: tool["input_schema"] for tool in anthropic.seen[0].body["tools"]} == untitled(published)


def untitled(value: Any) -> Any:
    """Return a schema without titles, because they only repeat the names and clients omit them."""
    if isinstance(value, dict):
        return {name: untitled(part) for name, part in value.items() if not (name == "title" and isinstance(part, str))}
    return [untitled(part) for part in value] if isinstance(value, list) else value


async def test_each_call_gets_its_own_return_even_if_it_was_not_run(service: Service) -> None:
    service.say("", [STEP, ("get_velocity", {"object_id": "nobody"}), ("step", {"duration": "long"}), LOOK])
    service.say("", [("answer", {"answer": 1})])
    episode = await play(service)
    ran, refused, misfit, after = service.seen[1].returns
    assert json.loads(ran)["steps"] == 160
    assert "nobody" in refused
    assert misfit.startswith("Not run. step: duration")
    assert after == "Not run."
    assert episode.turns[0].note in service.seen[1].last
    assert "Iterations left: 4" in service.seen[1].last
    assert errors_marked(service.seen[1].body) in ([], [False, True, True, True])


def errors_marked(body: dict[str, Any]) -> list[bool]:
    """Return which results are marked as errors, in formats that can mark them."""
    if "contents" in body:
        parts = [part for content in body["contents"] for part in content["parts"]]
        return ["error" in part["functionResponse"]["response"] for part in parts if "functionResponse" in part]
    blocks = [block for message in body["messages"] for block in message["content"] or [] if isinstance(block, dict)]
    return [block.get("is_error", False) for block in blocks if block.get("type") == "tool_result"]


@pytest.mark.parametrize("beside", ["", written(("find_objects", {}))])
async def test_a_native_call_in_the_text_protocol_is_not_run_and_the_conversation_continues(
    service: Service, beside: str
) -> None:
    service.say(beside, [STEP])
    service.say(written(("answer", {"answer": 1})))
    episode = await play(service, protocol="text")
    assert episode.turns[0].exchanges == ()
    assert "written as a JSON list" in service.seen[1].last
    assert episode.outcome is Outcome.ANSWERED


async def test_a_reply_without_calls_costs_an_iteration_and_the_model_reads_a_note(service: Service) -> None:
    service.say("Let me think.")
    service.say("", [("answer", {"answer": 1})])
    episode = await play(service)
    assert episode.outcome is Outcome.ANSWERED
    assert "no tool call" in service.seen[1].last
    assert service.seen[1].returns == []


@pytest.mark.parametrize(
    "written",
    ['{"duration": 0.8', "[0.8]", "0.8", '"0.8"', '{"duration": 0.8,}', pytest.param("[" * 100_000, id="deep")],
)
async def test_if_arguments_are_not_a_json_object_no_call_is_run_and_the_model_reads_why(
    openai: Service, written: str
) -> None:
    openai.say("", [LOOK, ("step", written)])
    openai.say("", [STEP, LOOK])
    openai.say("", [("answer", {"answer": 1})])
    episode = await play(openai)
    first = episode.turns[0]
    assert first.exchanges == ()
    assert "the arguments of step are not a JSON object" in first.note
    assert openai.seen[1].returns == ["Not run.", "Not run."]
    assert first.note in openai.seen[1].last
    assert json.loads(openai.seen[2].returns[0])["steps"] == 160


async def test_a_malformed_call_of_gemini_is_an_error_of_the_model_and_not_of_the_service(google: Service) -> None:
    google.say("", finish="MALFORMED_FUNCTION_CALL")
    google.say("", [("answer", {"answer": 1})])
    episode = await play(google)
    assert "not well-formed" in episode.turns[0].note
    assert (episode.outcome, len(google.seen)) == (Outcome.ANSWERED, 2)


CUT_OFF = {"openai": "length", "anthropic": "max_tokens", "google": "MAX_TOKENS"}


@pytest.mark.parametrize("protocol", ["native", "text"])
async def test_no_call_of_a_reply_that_was_cut_off_is_run(service: Service, protocol: str) -> None:
    calls = [] if protocol == "text" else [STEP]
    service.say(f"First {written(STEP)}, then", calls, finish=CUT_OFF[service.dialect.name])
    service.say(written(("answer", {"answer": 1})), [] if protocol == "text" else [("answer", {"answer": 1})])
    episode = await play(service, protocol=protocol, options=",max_tokens=50")
    assert episode.turns[0].exchanges == ()
    assert "cut off" in episode.turns[0].note
    assert "cut off" in service.seen[1].last
    assert episode.outcome is Outcome.ANSWERED


REFUSALS: dict[str, list[dict[str, Any]]] = {
    "openai": [
        {"finish": "content_filter"},
        {
            "extra": {
                "choices": [
                    {
                        "index": 0,
                        "finish_reason": "stop",
                        "message": {"role": "assistant", "content": None, "refusal": "I will not."},
                    }
                ]
            }
        },
    ],
    "anthropic": [{"finish": "refusal"}, {"text": "I cannot help with that.", "finish": "refusal"}],
    "google": [
        {"finish": "SAFETY"},
        {"extra": {"candidates": [], "promptFeedback": {"blockReason": "PROHIBITED_CONTENT"}}},
    ],
}


@pytest.mark.parametrize("which", [0, 1])
async def test_a_refusal_ends_the_episode_as_an_agent_error(service: Service, which: int) -> None:
    service.say(**REFUSALS[service.dialect.name][which])
    episode = await play(service)
    assert episode.outcome is Outcome.AGENT_ERROR
    assert "refused" in str(episode.error)
    assert episode.usage is not None
    assert episode.usage.input_tokens == 1000


OVERFLOW = {
    "openai": ("context_length_exceeded", "This model's maximum context length is 400000 tokens."),
    "anthropic": ("invalid_request_error", "prompt is too long: 208310 tokens > 200000 maximum"),
    "google": (
        "INVALID_ARGUMENT",
        "The input token count (1048600) exceeds the maximum number of tokens allowed (1048576).",
    ),
}


async def test_a_conversation_that_is_too_long_ends_the_episode_as_an_agent_error(service: Service) -> None:
    code, message = OVERFLOW[service.dialect.name]
    service.say("", [STEP])
    service.fail(400, message, code)
    episode = await play(service)
    assert episode.outcome is Outcome.AGENT_ERROR
    assert "no longer fits" in str(episode.error)
    assert len(episode.turns) == 1


async def test_a_full_context_window_during_a_reply_is_not_mistaken_for_the_limit_of_output(anthropic: Service) -> None:
    anthropic.say("Then", finish="model_context_window_exceeded")
    assert "context window" in str((await play(anthropic)).error)


@pytest.mark.parametrize("code", ["content_policy_violation", "invalid_prompt"])
async def test_a_conversation_that_is_refused_for_its_content_is_an_agent_error(openai: Service, code: str) -> None:
    openai.fail(400, "Invalid prompt: flagged.", code)
    episode = await play(openai)
    assert "for its content" in str(episode.error)


async def test_tokens_and_price_of_each_turn_are_recorded(service: Service) -> None:
    service.say("\n", [STEP])
    service.say("", [("answer", {"answer": 1})])
    episode = await play(service)
    assert episode.turns[0].reasoning == ""
    used = episode.turns[0].usage
    assert used is not None
    assert (used.input_tokens, used.output_tokens, used.cached_tokens) == (1000, 100, 600)
    assert used.cost_usd is not None
    assert used.cost_usd > 0
    assert episode.usage is not None
    assert episode.usage.cost_usd == pytest.approx(2 * used.cost_usd)


async def test_the_usage_of_a_failed_episode_is_counted(openai: Service) -> None:
    openai.say("", [STEP])
    openai.fail(401, "gone")
    used: list[Usage] = []
    async with (
        ModelAgent(parse_model("model:gpt-5.5", environ=openai.environ)) as agent,
        Client(open_episode(7).server()) as client,
    ):
        with pytest.raises(PermanentFailure):
            await play_episode(agent, client, episode_key(), VERSIONS, used=used)
    assert [(usage.input_tokens, usage.output_tokens) for usage in used] == [(1000, 100)]
    assert used[0].cost_usd


async def test_thoughts_and_cost_from_openrouter_are_recorded_and_the_thoughts_are_sent_back(
    openrouter: Service,
) -> None:
    openrouter.say("", [STEP], thought="Let it fall.")
    openrouter.say("", [("answer", {"answer": 1})])
    episode = await play(openrouter, options=",effort=high")
    assert episode.turns[0].reasoning == "Let it fall."
    assert episode.turns[0].usage is not None
    assert episode.turns[0].usage.cost_usd == 0.0125
    first, second = (seen.body for seen in openrouter.seen)
    assert first["reasoning"] == {"effort": "high"}
    assert second["messages"][1]["reasoning_details"][0]["text"] == "Let it fall."


async def test_signed_thoughts_are_sent_back_unchanged(anthropic: Service) -> None:
    anthropic.say("", [STEP], thought="Let it fall.")
    anthropic.say("", [("answer", {"answer": 1})])
    await play(anthropic, options=",effort=high")
    thought = anthropic.seen[1].body["messages"][1]["content"][0]
    assert thought == {"type": "thinking", "thinking": "Let it fall.", "signature": "c2ln"}


async def test_the_price_of_an_unlisted_model_is_unknown_and_not_zero(openai: Service) -> None:
    openai.say("", [("answer", {"answer": 1})])
    choice = parse_model("model:openai-compatible:my-own", base_url=openai.url, environ={})
    key = episode_key(agent=choice.name)
    async with (
        ModelAgent(choice) as agent,
        Client(open_episode(7).server()) as client,
    ):
        episode = await play_episode(agent, client, key, VERSIONS)
    assert episode.turns[0].usage is not None
    assert episode.turns[0].usage.cost_usd is None


async def test_half_a_surrogate_pair_in_a_reply_does_not_end_the_conversation(openai: Service) -> None:
    openai.say("a \ud800 b", [("step", '{"duration": "\ud800"}')])
    openai.say("", [("answer", {"answer": 1})])
    episode = await play(openai)
    assert (episode.outcome, len(openai.seen)) == (Outcome.ANSWERED, 2)


async def test_oracle_once_plays_with_a_model(openai: Service) -> None:
    openai.say("", [STEP, LOOK])
    openai.compute(lambda seen: Say("", [LOOK, ("answer", {"answer": speed(seen.returns[1])})]))
    choice = parse_model("model:gpt-5.5", environ=openai.environ)
    async with (
        ModelAgent(choice) as agent,
        Client(open_episode(7).server()) as client,
    ):
        key = episode_key()
        episode = await play_episode(OracleOnceAgent(agent), client, key, VERSIONS)
    assert episode.answer == pytest.approx(7.848, rel=1e-3)
    assert "Iterations left: 1" in openai.seen[1].last
