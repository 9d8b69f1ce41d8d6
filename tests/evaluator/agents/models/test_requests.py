"""Tests of provider failures, as the real client raises them, and of their handling. The tests control the clock."""

import math
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from email.utils import format_datetime
from typing import Any

import anyio
import pytest
from pydantic_ai.messages import ModelMessage, ModelRequest, ModelResponse, TextPart

from evaluator.agents.models.agent import ModelAgent
from evaluator.agents.models.choice import Lane, Lanes, Patience, parse_model
from evaluator.agents.models.requests import PermanentFailure, Requests
from evaluator.errors import AgentError, InfrastructureError
from tests.builders.providers import Service


@dataclass
class Clock:
    """A clock that advances only during pauses."""

    now: float = 1000.0
    pauses: list[float] = field(default_factory=list)

    async def sleep(self, duration_s: float) -> None:
        self.pauses.append(duration_s)
        self.now += duration_s


def text_of(response: ModelResponse) -> str | None:
    return response.text


@dataclass
class Desk:
    """Sends requests to one provider."""

    requests: Requests
    clock: Clock

    async def ask(self) -> str | None:
        return text_of(await self.requests.ask([ModelRequest.user_text_prompt("hello")]))


def open_desk(agent: ModelAgent) -> Desk:
    clock = Clock()
    requests = agent._open()
    requests.sleep, requests.clock, requests.luck = clock.sleep, lambda: clock.now, lambda: 1.0
    return Desk(requests, clock)


def agent_of(service: Service, **patience: Any) -> ModelAgent:
    text = f"model:{service.dialect.name}:{service.dialect.model}"
    return ModelAgent(parse_model(text, environ=service.environ), Lane(), Patience(**patience))


@pytest.fixture
async def desk(service: Service) -> AsyncIterator[Desk]:
    async with agent_of(service) as agent:
        yield open_desk(agent)


async def test_after_a_server_error_the_request_is_made_again_once_and_counted(service: Service, desk: Desk) -> None:
    service.fail(500)
    service.say("at last")
    assert await desk.ask() == "at last"
    assert len(service.seen) == 2
    assert desk.requests.retries == 1


async def test_pauses_double_up_to_a_longest_pause(openai: Service) -> None:
    for _ in range(5):
        openai.fail(503)
    openai.say("at last")
    async with agent_of(openai, longest_pause_s=5.0) as agent:
        desk = open_desk(agent)
        assert await desk.ask() == "at last"
    assert desk.clock.pauses == [1, 2, 4, 5, 5]


async def test_pauses_have_jitter_so_that_requests_that_failed_together_do_not_return_together(openai: Service) -> None:
    openai.fail(503)
    openai.say("at last")
    async with agent_of(openai) as agent:
        desk = open_desk(agent)
        desk.requests.luck = lambda: 0.0
        await desk.ask()
    assert desk.clock.pauses == [0.5]


async def test_after_a_rate_limit_the_pause_is_as_long_as_the_provider_asks(service: Service, desk: Desk) -> None:
    service.fail(429, Retry_After="17")
    service.say("at last")
    assert await desk.ask() == "at last"
    assert 17 <= sum(desk.clock.pauses) <= 19
    assert desk.requests.lane.shut_until == 1017


async def test_a_pause_may_be_given_as_a_fraction_or_a_date(openai: Service) -> None:
    date = format_datetime(datetime.now(UTC) + timedelta(seconds=300), usegmt=True)
    for value, low, high in (("2.5", 2.5, 2.7), (date, 250, 310), ("soon", 1, 1), ("-5", 1, 1)):
        openai.fail(429, Retry_After=value)
        openai.say("at last")
        async with agent_of(openai) as agent:
            desk = open_desk(agent)
            assert await desk.ask() == "at last"
        assert low <= desk.clock.pauses[0] <= high, value


async def test_the_pause_that_gemini_gives_in_the_body_is_read(google: Service) -> None:
    detail = {"@type": "type.googleapis.com/google.rpc.RetryInfo", "retryDelay": "33s"}
    google.fail(429, code="RESOURCE_EXHAUSTED", details=[detail])
    google.say("at last")
    async with agent_of(google) as agent:
        desk = open_desk(agent)
        await desk.ask()
    assert 33 <= sum(desk.clock.pauses) <= 35


async def test_a_pause_that_is_longer_than_the_patience_is_not_started(service: Service, desk: Desk) -> None:
    service.fail(429, Retry_After="86400")
    with pytest.raises(InfrastructureError, match="asked for a pause of 86400 s"):
        await desk.ask()
    assert desk.clock.pauses == []


async def test_a_pause_that_one_request_was_given_holds_for_all_requests_of_the_lane(openai: Service) -> None:
    openai.say("at last")
    async with agent_of(openai) as agent:
        desk = open_desk(agent)
        agent.lane.shut_until = desk.clock.now + 30
        assert await desk.ask() == "at last"
        assert 30 <= sum(desk.clock.pauses) <= 31
        agent.lane.shut_until = math.inf
        with pytest.raises(InfrastructureError, match="asked for a pause"):
            await desk.ask()
    assert len(openai.seen) == 1


async def test_asking_ends_after_the_last_attempt_with_the_message_of_the_provider(
    service: Service, desk: Desk
) -> None:
    for _ in range(6):
        service.fail(503, "the machines are on strike")
    with pytest.raises(InfrastructureError, match=r"in 6 attempts.*on strike"):
        await desk.ask()
    assert len(service.seen) == 6


async def test_asking_ends_when_the_pauses_together_are_too_long(openai: Service) -> None:
    for _ in range(6):
        openai.fail(429, Retry_After="10")
    async with agent_of(openai, total_wait_s=25.0) as agent:
        desk = open_desk(agent)
        with pytest.raises(InfrastructureError, match="in 3 attempts"):
            await desk.ask()
    assert sum(desk.clock.pauses) <= 25


async def test_a_silent_server_is_asked_again_after_the_time_out(service: Service) -> None:
    service.hang()
    service.say("at last")
    async with agent_of(service, timeout_s=0.3) as agent:
        with anyio.fail_after(120):
            assert await open_desk(agent).ask() == "at last"
    assert len(service.seen) == 2


async def test_a_server_that_sends_bytes_forever_is_given_up_after_the_time_out(service: Service) -> None:
    service.drip()
    service.say("at last")
    async with agent_of(service, timeout_s=0.5) as agent:
        with anyio.fail_after(120):
            assert await open_desk(agent).ask() == "at last"
    assert len(service.seen) == 2


async def test_after_a_reply_that_breaks_off_the_request_is_made_again(service: Service, desk: Desk) -> None:
    service.cut("a reply long enough to be cut in two")
    service.say("whole")
    assert await desk.ask() == "whole"


async def test_a_server_that_cannot_be_reached_is_asked_again_and_then_given_up(service: Service, desk: Desk) -> None:
    gone = parse_model(
        f"model:{service.dialect.name}:{service.dialect.model}",
        base_url="http://127.0.0.1:9",
        environ=service.environ,
    )
    async with ModelAgent(gone, Lane(), Patience(attempts=2)) as agent:
        with pytest.raises(InfrastructureError, match=r"in 2 attempts.*connection"):
            await open_desk(agent).ask()


@pytest.mark.parametrize("body", ["", "<html>Bad gateway</html>", "{}", "[]", '{"choices": []}', "null"])
async def test_after_an_unreadable_reply_the_request_is_made_again(openai: Service, body: str) -> None:
    openai.raw(body)
    openai.say("readable")
    async with agent_of(openai) as agent:
        assert await open_desk(agent).ask() == "readable"


@pytest.mark.parametrize(
    ("status", "code", "sentence"),
    [
        (401, "invalid_api_key", "refused the key"),
        (403, "permission_denied", "refused the key"),
        (404, "model_not_found", "no such model"),
        (402, "billing", "used up"),
        (429, "insufficient_quota", "used up"),
        (400, "unsupported_value", "rejected the request"),
        (422, "unprocessable", "rejected the request"),
    ],
)
async def test_after_a_permanent_failure_no_request_is_made_again(
    openai: Service, status: int, code: str, sentence: str
) -> None:
    openai.fail(status, "As I said.", code)
    async with agent_of(openai) as agent:
        with pytest.raises(PermanentFailure, match=rf"{sentence}.*As I said\."):
            await open_desk(agent).ask()
    assert len(openai.seen) == 1


@pytest.mark.parametrize("status", [400, 422])
async def test_a_rejection_in_the_middle_of_a_conversation_ends_only_that_conversation(
    openai: Service, status: int
) -> None:
    openai.fail(status, "Failed to call a function.", "tool_use_failed")
    async with agent_of(openai) as agent:
        talk: list[ModelMessage] = [ModelRequest.user_text_prompt("hello"), ModelResponse([TextPart("?")])]
        with pytest.raises(AgentError, match=r"rejected the request.*Failed to call"):
            await open_desk(agent).requests.ask([*talk, ModelRequest.user_text_prompt("again")])
    assert len(openai.seen) == 1


async def test_a_request_that_is_too_large_is_an_agent_error(anthropic: Service) -> None:
    anthropic.fail(413, "Request exceeds the maximum size", "request_too_large")
    async with agent_of(anthropic) as agent:
        with pytest.raises(AgentError, match="too large"):
            await open_desk(agent).ask()


async def test_a_key_that_a_provider_repeats_in_its_error_is_removed(service: Service, desk: Desk) -> None:
    key = next(value for name, value in service.environ.items() if name.endswith("_KEY"))
    service.fail(401, f"Incorrect API key provided: {key}.", "invalid_api_key")
    with pytest.raises(PermanentFailure, match=r"\[key\]") as caught:
        await desk.ask()
    assert key not in str(caught.value)
    assert key not in repr(desk.requests)
    assert any(key in value for value in service.seen[0].headers.values())


async def test_a_lane_limits_the_requests_at_a_time(openai: Service) -> None:
    openai.latency_s = 0.05
    for _ in range(8):
        openai.say("done")
    agent = agent_of(openai)
    agent.lane = Lane(limit=3)
    async with agent, anyio.create_task_group() as tasks:
        desk = open_desk(agent)
        for _ in range(8):
            tasks.start_soon(desk.ask)
    assert openai.most_under_way == 3


def test_agents_of_one_provider_share_a_lane_and_others_have_their_own() -> None:
    lanes = Lanes({"openai": 20}, default=4)
    assert lanes.of("openai") is lanes.of("openai")
    assert (lanes.of("openai").limit, lanes.of("vllm").limit) == (20, 4)
