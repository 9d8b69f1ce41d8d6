"""Failures of a provider, as its real client meets them, and what is made of them. Clock and pauses are ours."""

import math
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from email.utils import format_datetime
from typing import Any

import anyio
import pytest
from pydantic_ai.messages import ModelMessage, ModelRequest, ModelResponse, TextPart

from evaluator.errors import AgentError, InfrastructureError
from evaluator.models.agent import ModelAgent
from evaluator.models.choice import parse_model
from evaluator.models.failures import PermanentFailure
from evaluator.models.lanes import Lane, Lanes, Patience
from evaluator.models.requests import Requests
from tests.builders.providers import Service


@dataclass
class Clock:
    """Time that passes only in pauses."""

    now: float = 1000.0
    pauses: list[float] = field(default_factory=list)

    async def sleep(self, duration_s: float) -> None:
        self.pauses.append(duration_s)
        self.now += duration_s


def text_of(response: ModelResponse) -> str | None:
    return response.text


@dataclass
class Desk:
    """Asks one provider."""

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


async def test_a_server_error_is_asked_again_once_and_not_behind_our_back(service: Service, desk: Desk) -> None:
    service.fail(500)
    service.say("at last")
    assert await desk.ask() == "at last"
    assert len(service.seen) == 2
    assert desk.requests.retries == 1


async def test_pauses_double_and_end_at_a_ceiling(openai: Service) -> None:
    for _ in range(5):
        openai.fail(503)
    openai.say("at last")
    async with agent_of(openai, longest_pause_s=5.0) as agent:
        desk = open_desk(agent)
        assert await desk.ask() == "at last"
    assert desk.clock.pauses == [1, 2, 4, 5, 5]


async def test_pauses_are_jittered_so_that_what_failed_together_does_not_come_back_together(openai: Service) -> None:
    openai.fail(503)
    openai.say("at last")
    async with agent_of(openai) as agent:
        desk = open_desk(agent)
        desk.requests.luck = lambda: 0.0
        await desk.ask()
    assert desk.clock.pauses == [0.5]


async def test_a_rate_limit_is_waited_out_as_long_as_the_provider_says(service: Service, desk: Desk) -> None:
    service.fail(429, Retry_After="17")
    service.say("at last")
    assert await desk.ask() == "at last"
    assert 17 <= sum(desk.clock.pauses) <= 19
    assert desk.requests.lane.shut_until == 1017


async def test_a_wait_may_be_a_fraction_or_a_date(openai: Service) -> None:
    date = format_datetime(datetime.now(UTC) + timedelta(seconds=300), usegmt=True)
    for value, low, high in (("2.5", 2.5, 2.7), (date, 250, 310), ("soon", 1, 1), ("-5", 1, 1)):
        openai.fail(429, Retry_After=value)
        openai.say("at last")
        async with agent_of(openai) as agent:
            desk = open_desk(agent)
            assert await desk.ask() == "at last"
        assert low <= desk.clock.pauses[0] <= high, value


async def test_gemini_says_in_the_body_how_long_to_wait(google: Service) -> None:
    detail = {"@type": "type.googleapis.com/google.rpc.RetryInfo", "retryDelay": "33s"}
    google.fail(429, code="RESOURCE_EXHAUSTED", details=[detail])
    google.say("at last")
    async with agent_of(google) as agent:
        desk = open_desk(agent)
        await desk.ask()
    assert 33 <= sum(desk.clock.pauses) <= 35


async def test_a_wait_beyond_all_patience_is_not_begun(service: Service, desk: Desk) -> None:
    service.fail(429, Retry_After="86400")
    with pytest.raises(InfrastructureError, match="asked for a pause of 86400 s"):
        await desk.ask()
    assert desk.clock.pauses == []


async def test_a_lane_that_one_request_found_shut_is_shut_for_the_others(openai: Service) -> None:
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


async def test_asking_ends_after_so_many_attempts_with_the_provider_s_own_words(service: Service, desk: Desk) -> None:
    for _ in range(6):
        service.fail(503, "the machines are on strike")
    with pytest.raises(InfrastructureError, match=r"in 6 attempts.*on strike"):
        await desk.ask()
    assert len(service.seen) == 6


async def test_asking_ends_when_the_pauses_add_up(openai: Service) -> None:
    for _ in range(6):
        openai.fail(429, Retry_After="10")
    async with agent_of(openai, total_wait_s=25.0) as agent:
        desk = open_desk(agent)
        with pytest.raises(InfrastructureError, match="in 3 attempts"):
            await desk.ask()
    assert sum(desk.clock.pauses) <= 25


async def test_a_silent_server_is_given_up_after_the_time_out_and_asked_again(service: Service) -> None:
    service.hang()
    service.say("at last")
    async with agent_of(service, timeout_s=0.3) as agent:
        with anyio.fail_after(10):
            assert await open_desk(agent).ask() == "at last"
    assert len(service.seen) == 2


async def test_a_server_that_drips_is_given_up_after_the_time_out_too(service: Service) -> None:
    service.drip()
    service.say("at last")
    async with agent_of(service, timeout_s=0.5) as agent:
        with anyio.fail_after(5):
            assert await open_desk(agent).ask() == "at last"
    service.closed = True


async def test_a_reply_that_breaks_off_is_asked_for_again(service: Service, desk: Desk) -> None:
    service.cut("a reply long enough to be cut in two")
    service.say("whole")
    assert await desk.ask() == "whole"


async def test_a_server_that_is_not_there_is_asked_again_and_then_given_up(service: Service, desk: Desk) -> None:
    gone = parse_model(
        f"model:{service.dialect.name}:{service.dialect.model}",
        base_url="http://127.0.0.1:9",
        environ=service.environ,
    )
    async with ModelAgent(gone, Lane(), Patience(attempts=2)) as agent:
        with pytest.raises(InfrastructureError, match=r"in 2 attempts.*connection"):
            await open_desk(agent).ask()


@pytest.mark.parametrize("body", ["", "<html>Bad gateway</html>", "{}", "[]", '{"choices": []}', "null"])
async def test_a_reply_nobody_can_read_is_asked_for_again(openai: Service, body: str) -> None:
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
async def test_what_cannot_pass_is_not_asked_again(openai: Service, status: int, code: str, sentence: str) -> None:
    openai.fail(status, "As I said.", code)
    async with agent_of(openai) as agent:
        with pytest.raises(PermanentFailure, match=rf"{sentence}.*As I said\."):
            await open_desk(agent).ask()
    assert len(openai.seen) == 1


@pytest.mark.parametrize("status", [400, 422])
async def test_a_rejection_in_the_middle_of_a_conversation_is_that_conversation_s_end(
    openai: Service, status: int
) -> None:
    openai.fail(status, "Failed to call a function.", "tool_use_failed")
    async with agent_of(openai) as agent:
        talk: list[ModelMessage] = [ModelRequest.user_text_prompt("hello"), ModelResponse([TextPart("?")])]
        with pytest.raises(AgentError, match=r"rejected the request.*Failed to call"):
            await open_desk(agent).requests.ask([*talk, ModelRequest.user_text_prompt("again")])
    assert len(openai.seen) == 1


async def test_a_request_too_large_is_the_conversation_s_fault(anthropic: Service) -> None:
    anthropic.fail(413, "Request exceeds the maximum size", "request_too_large")
    async with agent_of(anthropic) as agent:
        with pytest.raises(AgentError, match="too large"):
            await open_desk(agent).ask()


async def test_a_provider_s_error_that_repeats_the_key_does_not_carry_it_on(service: Service, desk: Desk) -> None:
    key = next(value for name, value in service.environ.items() if name.endswith("_KEY"))
    service.fail(401, f"Incorrect API key provided: {key}.", "invalid_api_key")
    with pytest.raises(PermanentFailure, match=r"\[key\]") as caught:
        await desk.ask()
    assert key not in str(caught.value)
    assert key not in repr(desk.requests)
    assert any(key in value for value in service.seen[0].headers.values())


async def test_no_more_requests_are_under_way_than_the_lane_is_wide(openai: Service) -> None:
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
