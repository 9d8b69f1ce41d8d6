"""Tests of external programs: real MCP clients, and programs that crash, hang, make too many calls or spy."""

import json
import os
import signal
import sys
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from pathlib import Path

import anyio
import httpx2
import pytest

from evaluator.agents.external.agent import ExternalAgent, parse_external
from evaluator.agents.external.isolation import child_environment
from evaluator.agents.external.watched import WatchedEpisode
from evaluator.episode.connect import ProcessConnector, connect
from evaluator.episode.hosts import HostConnector, LocalHost
from evaluator.errors import InfrastructureError, UsageError
from evaluator.records.episode import Episode, Outcome
from scenes import find_pack, read_public
from tests.builders.paths import ROOT
from tests.builders.records import VERSIONS, episode_key

Words = Callable[..., list[str]]

SOLVE = """
await client.list_tools()
await client.call_tool("step", {"duration": 0.8})
result = await client.call_tool("get_velocity", {"object_id": "object_1"})
speed = abs(result.structured_content["velocity"][2])
print("The speed is", speed)
await client.call_tool("answer", {"answer": speed})
"""


def agent_of(words: list[str], **options: float) -> ExternalAgent:
    return parse_external(words, "host", None, **options)  # pyright: ignore[reportArgumentType] - numbers of both kinds


async def play(host: HostConnector, words: list[str], budget: int = 20, **options: float) -> Episode:
    agent = agent_of(words, **options)
    key = episode_key(agent=agent.name, budget=budget)
    with anyio.fail_after(120):
        episode = await agent.play(host, key, VERSIONS, [])
    assert Episode.model_validate_json(episode.model_dump_json()) == episode
    return episode


async def test_a_real_client_solves_a_scene_and_the_record_is_what_the_laboratory_logged(
    host: HostConnector, client: Words
) -> None:
    episode = await play(host, client(SOLVE))
    assert episode.outcome is Outcome.ANSWERED
    assert episode.answer == pytest.approx(7.848, rel=0.05)
    assert [turn.exchanges[0].call.tool for turn in episode.turns] == ["step", "get_velocity", "answer"]
    assert episode.turns[1].exchanges[0].content is not None
    assert episode.turns[1].exchanges[0].content["sim_time"] == pytest.approx(0.8)
    assert [turn.reasoning for turn in episode.turns] == ["", "", f"The speed is {episode.answer}"]
    assert episode.error is None
    assert "You may make 200 tool calls" in episode.prompt
    assert "iterations" not in episode.prompt


async def test_calls_beyond_the_budget_are_refused_and_not_counted(host: HostConnector, client: Words) -> None:
    body = """
for _ in range(5):
    result = await client.call_tool("step", {"duration": 0.1})
    print(result.is_error, result.content[0].text if result.is_error else "")
late = await client.call_tool("answer", {"answer": 7.848})
print(late.is_error)
"""
    episode = await play(host, client(body), max_calls=3)
    assert (episode.outcome, episode.answer, len(episode.turns)) == (Outcome.BUDGET_EXHAUSTED, None, 3)
    assert episode.allowance == episode.max_calls == 3
    said = episode.turns[-1].reasoning.splitlines()
    assert [line.split(" ", 1)[0] for line in said] == ["False"] * 3 + ["True"] * 3
    assert "its 3 calls are used up" in said[3]


async def test_an_answer_that_the_laboratory_refuses_does_not_count(host: HostConnector, client: Words) -> None:
    tries = """
await client.call_tool("answer", {"answer": "x" * 20_000})
await client.call_tool("answer", {"answer": "short"})
"""
    episode = await play(host, client(tries))
    assert (episode.outcome, episode.answer, len(episode.turns)) == (Outcome.ANSWERED, "short", 2)


async def test_a_program_that_ends_without_an_answer_is_an_agent_error(host: HostConnector, client: Words) -> None:
    episode = await play(host, client('await client.call_tool("step", {"duration": 0.1})'))
    assert (episode.outcome, episode.answer, len(episode.turns)) == (Outcome.AGENT_ERROR, None, 1)
    assert episode.error is not None
    assert "ended without an answer after 1 of 200 calls" in episode.error


async def test_a_crash_is_recorded_with_the_last_line_of_its_error_output(host: HostConnector, program: Words) -> None:
    episode = await play(host, program("print('hello'); raise SystemExit('thinking\\nout of credit\\n')"))
    assert (episode.outcome, episode.turns[0].exchanges) == (Outcome.AGENT_ERROR, ())
    assert episode.error is not None
    assert episode.error.endswith("ended with code 1: out of credit")
    assert episode.turns[0].reasoning == "hello"


async def test_a_crash_after_the_answer_does_not_void_the_answer(host: HostConnector, client: Words) -> None:
    episode = await play(host, client('await client.call_tool("answer", {"answer": "x"})\nraise SystemExit(3)'))
    assert (episode.outcome, episode.answer, episode.error) == (Outcome.ANSWERED, "x", None)


async def test_a_program_that_runs_on_after_its_answer_is_stopped_and_the_answer_counts(
    host: HostConnector, client: Words
) -> None:
    body = 'print("done", flush=True)\nawait client.call_tool("answer", {"answer": 1})\nawait anyio.sleep(600)'
    agent = replace(agent_of(client(body)), grace_s=0.1)
    key = episode_key(agent=agent.name, budget=5)
    with anyio.fail_after(120):
        episode = await agent.play(host, key, VERSIONS, [])
    assert (episode.outcome, episode.answer, episode.turns[-1].reasoning) == (Outcome.ANSWERED, 1, "done")


async def test_a_program_that_hangs_is_stopped_with_its_child_processes(
    host: HostConnector, program: Words, tmp_path: Path
) -> None:
    note = tmp_path / "pids"
    source = f"""
import os, signal, subprocess, sys, time
signal.signal(signal.SIGTERM, signal.SIG_IGN)
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
open({str(note)!r}, "w").write(f"{{os.getpid()}} {{child.pid}}")
print("waiting", flush=True)
time.sleep(600)
"""
    episode = await play(host, program(source), max_wall_s=1.5)
    assert episode.outcome is Outcome.AGENT_ERROR
    assert episode.error is not None
    assert "gave no answer within 1.5 s and was stopped" in episode.error
    assert episode.turns[0].reasoning == "waiting"
    await gone(*map(int, note.read_text(encoding="utf-8").split()))


async def test_child_processes_are_ended_with_the_program(host: HostConnector, program: Words, tmp_path: Path) -> None:
    note = tmp_path / "pid"
    source = f"""
import subprocess, sys
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
open({str(note)!r}, "w").write(str(child.pid))
"""
    episode = await play(host, program(source))
    assert episode.outcome is Outcome.AGENT_ERROR
    await gone(int(note.read_text(encoding="utf-8")))


def open_episodes(host: HostConnector) -> int:
    return httpx2.get(f"{host.base_url}/healthz").json()["episodes"]


async def test_an_interruption_ends_the_program_and_closes_the_episode(
    program: Words, tmp_path: Path, host: HostConnector
) -> None:
    before, note = open_episodes(host), tmp_path / "pid"
    words = program(f"import os, time; open({str(note)!r}, 'w').write(str(os.getpid())); time.sleep(600)")
    agent = agent_of(words)
    key = episode_key(agent=agent.name, budget=5)
    with anyio.fail_after(120):
        async with anyio.create_task_group() as tasks:
            tasks.start_soon(agent.play, host, key, VERSIONS, [])
            await until(lambda: note.exists() and bool(note.read_text(encoding="utf-8")))
            assert open_episodes(host) == before + 1
            tasks.cancel_scope.cancel()
    assert open_episodes(host) == before
    await gone(int(note.read_text(encoding="utf-8")))


async def gone(*pids: int) -> None:
    """Wait until processes are dead. A zombie process counts as dead."""
    await until(lambda: not any(map(_lives, pids)))


async def until(true: Callable[[], bool]) -> None:
    with anyio.fail_after(120):
        while True:
            if true():
                return
            await anyio.sleep(0.01)


def _lives(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    stat = Path(f"/proc/{pid}/stat")
    return not (stat.exists() and stat.read_text(encoding="utf-8").rpartition(")")[2].split()[0] == "Z")


async def test_the_prompt_comes_on_stdin_if_the_command_has_no_placeholder_for_it(
    host: HostConnector, program: Words
) -> None:
    source = "import sys; print(sys.argv[1:], sys.stdin.read())"
    episode = await play(host, program(source, "--url={mcp_url}", "{braces}"))
    said = episode.turns[0].reasoning
    assert said.startswith(f"['--url={host.base_url}/episodes/")
    assert "'{braces}'" in said
    assert said.endswith(episode.prompt)


async def test_a_program_finds_an_empty_folder_a_configuration_and_no_trace_of_the_packs(
    host: HostConnector, program: Words
) -> None:
    source = """
import json, os, sys
print(json.dumps({"cwd": os.listdir(), "env": dict(os.environ), "config": json.load(open(sys.argv[1]))}))
"""
    episode = await play(host, program(source))
    found = json.loads(episode.turns[0].reasoning)
    assert found["cwd"] == []
    assert found["config"]["mcpServers"]["physment"]["url"].startswith(f"{host.base_url}/episodes/")
    assert "PYTEST_CURRENT_TEST" not in found["env"]
    assert not [value for value in found["env"].values() if str(ROOT) in value]


def test_variables_that_reveal_where_the_packs_are_are_left_out(tmp_path: Path) -> None:
    ours = {
        "ORDINARY": "kept",
        "HOME": "/home/someone",
        "SUITE": f"a {ROOT}/scenes/Scene7",
        "MINE": str(tmp_path / "Scene7"),
        "PHYSMENT_ANYTHING": "x",
        "XDG_CONFIG_HOME": "/home/someone/.config",
        "PWD": "/",
        "VIRTUAL_ENV": "/",
        "PATH": os.pathsep.join(["/bin", f"{ROOT}/.venv/bin", "/usr/bin"]),
    }
    theirs = {"ORDINARY": "kept", "HOME": "/home/someone", "PATH": f"/bin{os.pathsep}/usr/bin"}
    assert child_environment(ours, tmp_path) == theirs
    assert child_environment({}, None) == {"PATH": os.defpath}


async def test_only_the_end_of_a_long_output_is_kept(host: HostConnector, program: Words) -> None:
    source = "import sys\nfor i in range(200_000): print(i)\nprint('the end')\nsys.stderr.write('y' * 10**6)"
    episode = await play(host, program(source))
    said = episode.turns[0].reasoning
    assert said.endswith("199999\nthe end")
    assert len(said) <= 20_000


async def test_nothing_is_carried_over_from_one_episode_to_the_next(
    host: HostConnector, program: Words, tmp_path: Path
) -> None:
    source = """
import json, os, pathlib, tempfile
places = [pathlib.Path.cwd(), pathlib.Path.home(), pathlib.Path(tempfile.gettempdir())]
print(json.dumps({str(place): os.listdir(place) for place in places}))
for place in places:
    (place / "notes").write_text("the answer")
"""
    login = tmp_path / "login"
    (login / ".config").mkdir(parents=True)
    (login / ".config" / "key").write_text("x", encoding="utf-8")
    empty = [json.loads((await play(host, program(source))).turns[0].reasoning) for _ in range(2)]
    assert [list(found.values()) for found in empty] == [[[], [], []]] * 2
    agent = replace(agent_of(program(source)), home=login)
    episode = await agent.play(host, episode_key(agent=agent.name), VERSIONS, [])
    started = json.loads(episode.turns[0].reasoning)
    assert list(started.values()) == [[], [".config"], []]
    places = [Path(place) for found in (*empty, started) for place in found]
    assert len(set(places)) == 9
    assert not any(place.exists() for place in places)
    assert [place.name for place in login.iterdir()] == [".config"]


async def test_a_host_that_cannot_be_reached_is_an_infrastructure_error(program: Words) -> None:
    with pytest.raises(InfrastructureError, match="cannot be reached"):
        await play(HostConnector("http://127.0.0.1:9"), program("pass"))


async def test_a_host_killed_during_an_episode_is_an_infrastructure_error_and_the_program_is_ended(
    program: Words, tmp_path: Path
) -> None:
    note = tmp_path / "pid"
    local = LocalHost()
    async with local as laboratory:
        assert local._process is not None
        source = f"""
import os, time
open({str(note)!r}, "w").write(str(os.getpid()))
os.kill({local._process.pid}, {int(signal.SIGKILL)})
time.sleep(600)
"""
        with pytest.raises(InfrastructureError, match="log of calls could not be read"):
            await play(laboratory, program(source))
    await gone(int(note.read_text(encoding="utf-8")))


async def test_a_laboratory_without_an_address_is_refused(program: Words) -> None:
    agent = agent_of(program("pass"))
    key = episode_key(agent=agent.name, budget=5)
    with pytest.raises(UsageError, match="needs a laboratory with an address"):
        await agent.play(ProcessConnector(("x",)), key, VERSIONS, [])


@pytest.mark.parametrize(
    ("words", "server", "said"),
    [
        ([], "host", "needs a command after --"),
        ([sys.executable, "{prompt}"], "host", "could not find the laboratory"),
        (["no-such-program", "{mcp_url}"], "host", "there is no program 'no-such-program'"),
        ([sys.executable, "{mcp_url}"], "stdio", "--server host, or the URL"),
        ([sys.executable, "{mcp_url}"], "python -m x", "--server host, or the URL"),
    ],
)
def test_a_command_that_cannot_play_is_refused(words: list[str], server: str, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        parse_external(words, server, None)


def test_a_relative_path_is_refused_because_the_command_runs_elsewhere(tmp_path: Path) -> None:
    (tmp_path / "agent.py").write_text("", encoding="utf-8")
    with pytest.raises(UsageError, match=r"write the path in full: .*/agent\.py"):
        parse_external([sys.executable, os.path.relpath(tmp_path / "agent.py"), "{mcp_url}"], "host", None)


def test_an_agent_that_could_read_the_packs_is_marked_unsealed_and_has_another_name(tmp_path: Path) -> None:
    words, ours = [sys.executable, "{mcp_url}"], {"PHYSMENT_HOST_TOKEN": "x"}
    here = parse_external(words, "host", None)
    assert here.unsealed is not None
    assert "who can read the scene packs" in here.unsealed
    assert here.name.startswith("external-unsealed:python")
    vouched = parse_external([sys.executable, "{mcp_config}"], "host", None, vouched=True)
    assert (vouched.unsealed, vouched.name) == (None, here.name.replace("-unsealed", ""))
    far = "https://lab.example"
    same_packs = parse_external(words, far, None, environ=ours)
    assert same_packs.unsealed == here.unsealed
    empty = tmp_path / "none"
    empty.mkdir()
    assert parse_external(words, far, empty, environ=ours).unsealed is None
    local = parse_external(words, "http://127.0.0.1:8000", empty, environ=ours)
    assert local.unsealed == "the host of the laboratory is on the machine where it runs"


def test_an_agent_is_unsealed_on_a_host_where_anybody_may_open_episodes(tmp_path: Path) -> None:
    empty = tmp_path / "none"
    empty.mkdir()
    for vouched in (True, False):
        open_to_all = parse_external(
            [sys.executable, "{mcp_config}"], "https://lab.example", empty, vouched=vouched, environ={}
        )
        assert open_to_all.unsealed is not None
        assert "practise" in open_to_all.unsealed


async def test_an_agent_cannot_open_episodes_on_the_evaluators_host(program: Words) -> None:
    source = """
import json, sys, urllib.error, urllib.request
base = json.load(open(sys.argv[1]))["mcpServers"]["physment"]["url"].partition("/episodes/")[0]
request = urllib.request.Request(base + "/episodes", b'{"scene": 7}', {"Content-Type": "application/json"})
try:
    print(urllib.request.urlopen(request).status)
except urllib.error.HTTPError as error:
    print(error.code)
"""
    async with connect("host", None) as laboratory:
        assert isinstance(laboratory, HostConnector)
        assert laboratory.token is not None
        assert laboratory.token not in repr(laboratory)
        episode = await play(laboratory, program(source))
    assert episode.turns[0].reasoning == "401"


def test_the_facts_of_an_agent_hold_its_command_and_bounds_but_no_secrets() -> None:
    agent = parse_external([sys.executable, "{mcp_url}", "--fast"], "host", None, max_calls=7)
    assert json.loads(json.dumps(agent.facts())) == {
        "command": [sys.executable, "{mcp_url}", "--fast"],
        "max_calls": 7,
        "max_wall_s": 1800.0,
        "unsealed": agent.unsealed,
    }


def test_the_limit_of_calls_is_the_scenes_or_follows_the_budget_unless_it_is_set() -> None:
    words = [sys.executable, "{mcp_url}"]
    agent = parse_external(words, "host", None)
    limits = read_public(find_pack(28)).limits
    assert limits is not None
    assert limits.calls == 150
    assert read_public(find_pack(7)).limits is None
    assert agent.calls_for(7, 5) == 50
    assert agent.calls_for(28, 5) == 151  # 150 calls and the answer
    assert agent.calls_for(999, 5) == 50  # a scene whose pack only the host has
    assert parse_external(words, "host", None, max_calls=7).calls_for(28, 5) == 7


async def test_arguments_that_the_laboratory_refuses_as_too_large_are_left_out_with_the_reason(
    host: HostConnector, client: Words
) -> None:
    body = """
deep = []
for _ in range(90):
    deep = [deep]
await client.call_tool("step", {"duration": deep})
await client.call_tool("answer", {"answer": 1})
"""
    episode = await play(host, client(body))
    (first,), (last,) = (turn.exchanges for turn in episode.turns)
    assert first.is_error
    assert first.text == "the arguments of a call nest at most 16 levels"
    assert first.call.arguments == {"left_out": first.text}
    assert (last.call.arguments, episode.answer) == ({"answer": 1}, 1)


@pytest.mark.parametrize(
    ("status", "body", "said"),
    [
        (200, b'{"episode_id": "a", "mcp_url": "http://127.0.0.1:9/mcp"}', "keeps no logs of calls"),
        (200, b'{"episode_id": "a", "mcp_url": "http://127.0.0.1:9/mcp", "owner_token": "x"}', "opening prompt"),
        (401, b'{"error": "episodes are opened with the token of this host"}', "opened no episode: episodes are"),
    ],
)
async def test_a_host_without_call_logs_is_an_infrastructure_error(
    program: Words, web_server: Callable[[int, bytes], AbstractContextManager[str]], status: int, body: bytes, said: str
) -> None:
    with web_server(status, body) as address, pytest.raises(InfrastructureError, match=said):
        await play(HostConnector(address), program("pass"))


async def test_a_malformed_log_is_an_infrastructure_error(
    web_server: Callable[[int, bytes], AbstractContextManager[str]],
) -> None:
    for status, body in ((200, b"<html>"), (200, b'{"calls": 1}'), (500, b"oh")):
        with web_server(status, body) as address:
            async with httpx2.AsyncClient(base_url=address) as http:
                episode = WatchedEpisode("", None, http, "/episodes/a", "x")
                assert not await episode.until_end()
                with pytest.raises(InfrastructureError, match="log of calls could not be read") as failed:
                    await episode.turns()
        assert len(str(failed.value).splitlines()) == 1
