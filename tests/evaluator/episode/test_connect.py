"""Tests of the values of `--server`, and that server failures are infrastructure errors with one sentence."""

import shlex
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import anyio
import pytest

from evaluator.agents.reference import ScriptedAgent
from evaluator.episode.connect import connect
from evaluator.episode.hosts import LocalHost
from evaluator.episode.loop import play_episode
from evaluator.episode.player import Agent, Briefing, Feedback, Reply
from evaluator.errors import InfrastructureError, PermanentFailure, UsageError
from evaluator.records.episode import Episode, EpisodeKey, ToolCall
from tests.builders.records import ANSWER, STEP, VERSIONS, call, episode_key

PYTHON = shlex.quote(sys.executable)

DYING = """
import os
import sys

import anyio
import mcp_types as types
from mcp.server.lowlevel import Server
from mcp.server.stdio import stdio_server

left = int(sys.argv[1])

async def list_tools(ctx, params):
    tools = [types.Tool(name=name, input_schema={"type": "object"}) for name in ("step", "answer")]
    return types.ListToolsResult(tools=tools)

async def call_tool(ctx, params):
    global left
    if left == 0:
        print("starting up", "out of smoke", sep="\\n", file=sys.stderr, flush=True)
        os._exit(3)
    left -= 1
    return types.CallToolResult(content=[types.TextContent(type="text", text="{}")], structured_content={})

async def get_prompt(ctx, params):
    message = types.PromptMessage(role="user", content=types.TextContent(type="text", text=" ".join(sys.argv[2:])))
    return types.GetPromptResult(messages=[message])

async def run():
    server = Server("dying", on_list_tools=list_tools, on_call_tool=call_tool, on_get_prompt=get_prompt)
    async with stdio_server() as (read, write):
        await server.run(read, write, server.create_initialization_options())

anyio.run(run)
"""


def script(*turns: tuple[ToolCall, ...]) -> ScriptedAgent:
    return ScriptedAgent("script", {None: turns})


async def play(server: str, agent: Agent, scene: int = 7, seed: int = 0, scenes_dir: Path | None = None) -> Episode:
    key = episode_key(scene, seed=seed, agent=agent.name, budget=5)
    with anyio.fail_after(120):
        async with connect(server, scenes_dir) as laboratory, laboratory.open(scene, seed) as client:
            return await play_episode(agent, client, key, VERSIONS)


@pytest.fixture
def dying(tmp_path: Path) -> str:
    """Return the command of a server that dies after some calls; the test appends their number and further words."""
    file = tmp_path / "a folder" / "dying.py"
    file.parent.mkdir()
    file.write_text(DYING, encoding="utf-8")
    return f"{PYTHON} {shlex.quote(str(file))}"


async def test_the_placeholders_of_a_command_are_replaced_by_scene_and_seed(dying: str) -> None:
    episode = await play(f"{dying} 9 --level={{scene}} 'no {{seed}}' {{}}", script((ANSWER,)), scene=21, seed=5)
    assert episode.prompt == "--level=21 no 5 {}"


async def test_scene_and_seed_are_appended_to_a_command_without_placeholders(dying: str) -> None:
    episode = await play(f"{dying} 9", script((ANSWER,)), scene=21, seed=5)
    assert episode.prompt == "--scene 21 --seed 5"


async def test_the_command_of_the_laboratory_serves_the_requested_scene_and_seed() -> None:
    agent = script((call("get_parameters", object_id="object_1"), ANSWER))
    by_command = await play(f"{PYTHON} -m physment_mcp --scene {{scene}} --seed {{seed}}", agent, seed=4)
    by_name = await play("stdio", agent, seed=4)
    assert by_command.prompt == by_name.prompt
    assert by_command.turns[0].exchanges[0].content == by_name.turns[0].exchanges[0].content


@pytest.mark.parametrize("calls", [0, 1, 3])
async def test_the_error_of_a_server_that_dies_holds_the_last_line_that_it_wrote(dying: str, calls: int) -> None:
    agent = script((STEP, STEP), (STEP, STEP), (ANSWER,))
    with pytest.raises(InfrastructureError) as failed:
        await play(f"{dying} {calls}", agent)
    assert str(failed.value).count("\n") == 0
    assert "out of smoke" in str(failed.value)


@pytest.mark.parametrize(
    ("command", "said"),
    [
        ("no-such-program {scene}", "there is no such program"),
        ("/ {scene}", "it may not be executed"),
        (f"{PYTHON} -c 'import sys; sys.exit(\"no licence\")' {{scene}}", "no licence"),
        (f"{PYTHON} -c 'print(1)' {{scene}}", "Connection closed"),
        (f"{PYTHON} -m physment_mcp --scene 999 --seed {{seed}}", "no scene 999"),
    ],
    ids=["missing", "folder", "refuses", "no server", "no scene"],
)
async def test_a_command_that_does_not_serve_gives_one_sentence(command: str, said: str) -> None:
    with pytest.raises(InfrastructureError) as failed:
        await play(command, script((ANSWER,)))
    assert said in str(failed.value)
    assert len(str(failed.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("server", "said"),
    [
        ("", "--server is empty"),
        ("   ", "--server is empty"),
        ("python 'unfinished", "is not a command"),
        ("http://", "not the URL of a host"),
        ("http://127.0.0.1:99999", "not the URL of a host"),
        ("http://[::1", "not a URL"),
    ],
)
async def test_a_malformed_server_option_is_refused(server: str, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        await play(server, script((ANSWER,)))


async def test_many_episodes_at_a_time_are_opened_on_a_host_by_its_address(host_url: str) -> None:
    episodes: list[Episode] = []

    async def play_seed(address: str, seed: int) -> None:
        episodes.append(await play(address, script((STEP, STEP), (ANSWER,)), seed=seed))

    async with anyio.create_task_group() as tasks:
        for seed in range(8):
            tasks.start_soon(play_seed, host_url + "/", seed)
    assert sorted(episode.key.seed for episode in episodes) == list(range(8))
    times = [
        [exchange.content["sim_time"] for exchange in episode.turns[0].exchanges if exchange.content]
        for episode in episodes
    ]
    assert times == [[pytest.approx(0.1), pytest.approx(0.2)]] * 8


async def test_an_episode_is_closed_on_its_host_however_it_ends() -> None:
    class Falling:
        name = "falling"

        def player(self, key: EpisodeKey, briefing: Briefing) -> "Falling":
            return self

        async def act(self, feedback: Feedback | None) -> Reply:
            raise InfrastructureError("the provider is down")

    async with LocalHost(max_episodes=1) as host:
        for _ in range(2):
            await play(host.base_url, script((ANSWER,)))
            await play(host.base_url, script((STEP,)))
            with pytest.raises(InfrastructureError, match="the provider is down"):
                await play(host.base_url, Falling())
        with pytest.raises(InfrastructureError, match=r"opened no episode: .*999"):
            await play(host.base_url, script((ANSWER,)), scene=999)
        async with host.open(7, 0):
            with pytest.raises(InfrastructureError, match="opened no episode"):
                await play(host.base_url, script((ANSWER,)))


async def test_a_host_that_is_killed_or_down_is_an_infrastructure_error() -> None:
    class Murderous:
        name = "murderous"

        def __init__(self, host: LocalHost) -> None:
            self.host = host

        def player(self, key: EpisodeKey, briefing: Briefing) -> "Murderous":
            return self

        async def act(self, feedback: Feedback | None) -> Reply:
            assert self.host._process is not None
            self.host._process.kill()
            self.host._process.wait()
            return Reply(calls=(STEP,))

    local = LocalHost()
    async with local as host:
        with pytest.raises(InfrastructureError) as failed:
            await play(host.base_url, Murderous(local))
        assert len(str(failed.value).splitlines()) == 1
        with pytest.raises(InfrastructureError, match="cannot be reached"):
            await play(host.base_url, script((ANSWER,)))


@pytest.mark.parametrize("server", ["stdio", "host"])
@pytest.mark.parametrize("error", [PermanentFailure("the provider refused the key"), UsageError("no such option")])
async def test_an_error_of_the_agents_side_is_not_reported_as_an_error_of_the_server(
    server: str, error: Exception, host_url: str
) -> None:
    class Failing:
        name = "failing"

        def player(self, key: EpisodeKey, briefing: Briefing) -> "Failing":
            return self

        async def act(self, feedback: Feedback | None) -> Reply:
            raise error

    with pytest.raises(type(error)) as failed:
        await play(host_url if server == "host" else server, Failing())
    assert failed.value is error


@pytest.mark.parametrize(
    ("status", "body", "said"),
    [
        (200, b'{"ok": true}', "is no PhysMent host: it answered 200"),
        (200, b"[1]", "is no PhysMent host"),
        (500, b"[1]", "is no PhysMent host: it answered 500"),
        (404, b"<html>", "is no PhysMent host: it answered 404"),
        (503, b'{"error": "full"}', "opened no episode: full"),
        (200, b'{"episode_id": "a", "mcp_url": "http://127.0.0.1:9/mcp"}', "failed"),
    ],
)
async def test_a_web_server_that_is_not_a_host_gives_one_sentence(
    web_server: Callable[[int, bytes], AbstractContextManager[str]], status: int, body: bytes, said: str
) -> None:
    with web_server(status, body) as address, pytest.raises(InfrastructureError) as failed:
        await play(address, script((ANSWER,)))
    assert said in str(failed.value)


async def test_servers_that_the_evaluator_starts_serve_the_given_folder_of_packs(tmp_path: Path) -> None:
    for server in ("stdio", "host"):
        with pytest.raises((InfrastructureError, UsageError)) as failed:
            await play(server, script((ANSWER,)), scenes_dir=tmp_path / "none")
        assert len(str(failed.value).splitlines()) == 1
