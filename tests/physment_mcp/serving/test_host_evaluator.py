"""Tests of the evaluator with a host that requires a token, and with a host that loses its episode."""

import json
import subprocess
import sys
from collections.abc import Generator

import anyio
import httpx2
import pytest
from mcp import Client

from evaluator.episode.connect import connect
from evaluator.episode.hosts import TOKEN_VARIABLE, HostConnector, LocalHost
from evaluator.episode.loop import play_episode
from evaluator.episode.player import Briefing, Feedback, Reply
from evaluator.errors import InfrastructureError
from evaluator.records.episode import EpisodeKey
from tests.builders.records import STEP, VERSIONS, episode_key

KEY = episode_key(budget=3)

GUARDED = """
from physment_mcp.serving.episode_server import EpisodeServer
from physment_mcp.serving.listening import serve
serve(EpisodeServer(token="ours", exposed=True, max_episodes=2), "127.0.0.1", 0)
"""
"""A host that is configured for other machines, on an address that only this machine reaches."""


@pytest.fixture(scope="module")
def guarded() -> Generator[str]:
    with subprocess.Popen([sys.executable, "-c", GUARDED], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield json.loads(process.stdout.readline())["listening"]
        finally:
            process.terminate()
            process.communicate(timeout=300)


async def test_the_evaluator_sends_its_token_to_a_host_that_requires_it(
    guarded: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(TOKEN_VARIABLE, "ours")
    with anyio.fail_after(120):
        for _ in range(3):  # the limit is two, so an episode that is left open is noticed
            async with connect(guarded, None) as laboratory, laboratory.open(7, 0) as client:
                assert not (await client.call_tool("step", {"duration": 0.1})).is_error
                assert "Scene" in (await client.get_prompt("scene", {})).messages[0].content.text
    async with httpx2.AsyncClient(base_url=guarded) as http:
        assert (await http.get("/healthz")).json()["episodes"] == 0


@pytest.mark.parametrize(
    ("url", "told"),
    [
        ("http://lab.example/episodes/x/mcp", True), ("http://LAB.example:80/", True), ("https://lab.example/", False),
        ("http://lab.example:8000/", False), ("http://lab.example.evil/", False), ("http://evil.example/", False),
    ],
)  # fmt: skip
def test_the_token_is_sent_to_no_other_host(url: str, told: bool) -> None:
    assert bool(HostConnector("http://lab.example", "ours")._authorization(url)) == told


@pytest.mark.parametrize("token", ["", "theirs"])
async def test_without_the_right_token_the_evaluator_says_so_in_one_sentence(
    guarded: str, monkeypatch: pytest.MonkeyPatch, token: str
) -> None:
    monkeypatch.setenv(TOKEN_VARIABLE, token)
    with (
        anyio.fail_after(120),
        pytest.raises(InfrastructureError, match=rf"opened no episode: .*{TOKEN_VARIABLE}") as failed,
    ):
        async with connect(guarded, None) as laboratory, laboratory.open(7, 0):
            pytest.fail("it has no right to an episode")
    assert len(str(failed.value).splitlines()) == 1


async def test_an_episode_that_its_host_lost_is_not_the_agents_fault() -> None:
    class Losing:
        name = "losing"

        def __init__(self, url: str) -> None:
            self.url = url

        def player(self, key: EpisodeKey, briefing: Briefing) -> "Losing":
            return self

        async def act(self, feedback: Feedback | None) -> Reply:
            if feedback is not None:
                async with httpx2.AsyncClient() as http:
                    assert (await http.delete(self.url.removesuffix("/mcp"))).status_code == 204
            return Reply(calls=(STEP,))

    with anyio.fail_after(120):
        async with LocalHost() as host, httpx2.AsyncClient(base_url=host.base_url) as http:
            url = (await host.request_episode(http, {"scene": 7, "seed": 0}))["mcp_url"]
            async with Client(url) as client:
                with pytest.raises(InfrastructureError, match="the host closed the episode"):
                    await play_episode(Losing(url), client, KEY, VERSIONS)
