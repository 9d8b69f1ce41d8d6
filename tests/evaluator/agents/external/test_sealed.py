"""Tests that isolated programs cannot find, play or disturb each other's episodes."""

import json
import os
import pwd
import sys
from dataclasses import replace
from pathlib import Path

import anyio
import pytest
from mcp import Client

from evaluator.agents.external.agent import ExternalAgent, parse_external
from evaluator.agents.external.isolation import TOKEN, URL, SystemUser, SystemUsers, system_users
from evaluator.agents.external.watched import watch_episode
from evaluator.commands.run_options import read_options
from evaluator.episode.hosts import HostConnector, LocalHost
from evaluator.errors import UsageError
from evaluator.records.episode import Episode, Outcome
from tests.builders.records import VERSIONS, episode_key
from tests.evaluator.agents.external.test_external import Words, gone
from tests.evaluator.agents.external.test_external_options import parsed

as_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can start programs as other users")
READS_CONFIG = """
import json, os, sys
server = json.load(open(sys.argv[1]))["mcpServers"]["physment"]
print(json.dumps({"server": server, "url": os.environ["PHYSMENT_MCP_URL"], "token": os.environ["PHYSMENT_MCP_TOKEN"]}))
import anyio, httpx2
from mcp import Client
from mcp.client.streamable_http import streamable_http_client
async def play():
    async with httpx2.AsyncClient(headers=server["headers"]) as http:
        async with Client(streamable_http_client(server["url"], http_client=http)) as client:
            await client.call_tool("answer", {"answer": 5})
anyio.run(play)
"""


def sealed(words: list[str], users: SystemUsers | None = None) -> ExternalAgent:
    agent = parse_external(words, "host", None, vouched=True)
    return agent if users is None else replace(agent, users=users)


async def play(host: HostConnector, agent: ExternalAgent) -> Episode:
    with anyio.fail_after(120):
        return await agent.play(host, episode_key(agent=agent.name), VERSIONS, [])


async def test_a_sealed_program_finds_address_and_token_in_a_file_and_in_its_environment(
    host: HostConnector, program: Words
) -> None:
    episode = await play(host, sealed(program(READS_CONFIG)))
    assert (episode.outcome, episode.answer) == (Outcome.ANSWERED, 5)
    said = json.loads(episode.turns[-1].reasoning)
    assert said["server"]["url"] == said["url"]
    assert said["server"]["headers"] == {"Authorization": f"Bearer {said['token']}"}
    assert said["token"] not in said["url"]


async def test_the_address_alone_reaches_no_guarded_episode() -> None:
    async with (
        LocalHost(token="the-token-of-the-host") as host,
        watch_episode(host, 7, 0, 5, guarded=True) as guarded,
        watch_episode(host, 7, 0, 5) as other,
    ):
        assert guarded.token
        assert other.token is None
        with pytest.raises(Exception):  # noqa: B017, PT011 - the client chooses how to report the refusal
            async with Client(guarded.mcp_url) as client:
                await client.list_tools()
        assert "lab" in (await guarded.prompt(episode_key())).lower()
        assert await guarded.turns() == ()


@pytest.mark.parametrize("header", [{}, {"Authorization": "Bearer wrong"}])
async def test_requests_without_the_token_are_refused_with_401(host: HostConnector, header: dict[str, str]) -> None:
    import httpx2

    async with watch_episode(host, 7, 0, 5, guarded=True) as episode, httpx2.AsyncClient(headers=header) as http:
        assert (await http.post(episode.mcp_url, json={})).status_code == 401
        assert (await http.get(episode.mcp_url)).status_code == 401
        log = episode.mcp_url.replace("/mcp", "/calls")
        assert (await http.get(log)).status_code == 401
        assert (await http.get(log, headers={"Authorization": f"Bearer {episode.token}"})).status_code == 401


def test_the_address_may_not_stand_in_the_command_line_of_a_sealed_program() -> None:
    with pytest.raises(UsageError, match="every user of the machine can read"):
        parse_external([sys.executable, "{mcp_url}"], "host", None, vouched=True)
    assert parse_external([sys.executable, "{mcp_config}"], "host", None, vouched=True).guarded
    assert parse_external([sys.executable, "-e", URL, "-e", TOKEN], "host", None, vouched=True).guarded
    assert not parse_external([sys.executable, "{mcp_url}"], "host", None).guarded


def options(*words: str) -> int:
    own = ("--agent", "external", *words, "--", sys.executable, "{mcp_config}")
    return read_options(parsed(*own), {}).concurrency


def test_sealed_programs_run_one_at_a_time_unless_they_have_users_of_their_own() -> None:
    assert options("--sealed") == 1
    assert options("--sealed", "--concurrency", "1") == 1
    with pytest.raises(UsageError, match="name 2 system users with --sealed-users"):
        options("--sealed", "--concurrency", "2")
    with pytest.raises(UsageError, match="name 3 system users"):
        options("--sealed", "--sealed-users", "a,b", "--concurrency", "3")
    assert options("--sealed", "--sealed-users", "a,b") == 2
    with pytest.raises(UsageError, match="belongs to --sealed"):
        options("--sealed-users", "a")
    with pytest.raises(UsageError, match="--executor local"):
        options("--sealed", "--sealed-users", "a", "--executor", "ray")


@as_root
@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["root"], "root runs this program"),
        (["0"], "0 runs this program"),
        (["no-such-user"], "there is no user 'no-such-user'"),
        (["9" * 30], "there is no user"),
        (["nobody", "nobody"], "named twice"),
    ],
)
def test_users_that_could_not_be_sealed_are_refused(names: list[str], said: str) -> None:
    with pytest.raises(UsageError, match=said):
        system_users(names)


def test_only_root_can_name_users(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "geteuid", lambda: 1000)
    with pytest.raises(UsageError, match="only root"):
        system_users(["nobody"])


@as_root
def test_a_user_is_found_by_name_and_number() -> None:
    nobody = pwd.getpwnam("nobody")
    expected = [SystemUser(nobody.pw_uid, nobody.pw_gid)]
    assert system_users(["nobody"]) == system_users([str(nobody.pw_uid)]) == expected


UID = 64_123
"""User id that no user of this machine has, so that killing all its processes affects only those of the test."""


@as_root
async def test_a_program_runs_as_its_user_in_folders_of_its_own_and_leaves_no_process(
    host: HostConnector, tmp_path: Path
) -> None:
    source = """
import json, os, pathlib, subprocess, sys
secret = pathlib.Path(sys.argv[1]).stat()
daemon = subprocess.Popen(["sleep", "600"], start_new_session=True)
home = pathlib.Path.home()
(home / "x").write_text("x")
print(json.dumps({"uid": os.getuid(), "groups": os.getgroups(), "mode": secret.st_mode & 0o777, "owner": secret.st_uid,
    "daemon": daemon.pid, "base": oct(home.parent.stat().st_mode & 0o777)}), flush=True)
"""
    words = ["/usr/bin/env", "python3", "-c", source, "{mcp_config}", "{prompt}"]
    episode = await play(host, sealed(words, SystemUsers([SystemUser(UID, UID)])))
    assert episode.turns, episode.error
    said = json.loads(episode.turns[0].reasoning)
    assert (said["uid"], said["groups"], said["mode"], said["owner"]) == (UID, [], 0o600, UID)
    assert said["base"] == "0o700"
    await gone(said["daemon"])


async def test_a_user_runs_one_program_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    ended: list[SystemUser] = []
    monkeypatch.setattr("evaluator.agents.external.isolation.end_processes_of", ended.append)
    users, at_work, most = SystemUsers([SystemUser(UID, UID), SystemUser(UID + 1, UID)]), set[SystemUser](), 0

    async def work() -> None:
        nonlocal most
        async with users.one() as user:
            assert user is not None
            assert user not in at_work
            at_work.add(user)
            most = max(most, len(at_work))
            await anyio.sleep(0.01)
            at_work.remove(user)

    async with anyio.create_task_group() as tasks:
        for _ in range(10):
            tasks.start_soon(work)
    assert most == 2
    assert len(ended) == 10
    async with SystemUsers().one() as nobody:
        assert nobody is None
