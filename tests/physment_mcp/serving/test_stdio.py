"""Tests of the command line and of an episode on stdio: MCP on stdout, one sentence for the operator on stderr."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import anyio
import mujoco
import pytest
from mcp import Client, MCPError, StdioServerParameters
from mcp_types import PromptReference

from physment_mcp import __version__
from physment_mcp.commands.program import main
from tests.builders.laboratory import Command, WritePack


@pytest.mark.parametrize("mode", ["auto", "legacy"])
async def test_an_episode_is_played_over_stdio(mode: Any) -> None:
    server = StdioServerParameters(command=sys.executable, args=["-m", "physment_mcp", "--scene", "7"])
    with anyio.fail_after(120):
        async with Client(server, mode=mode) as client:
            assert "# Scene: " in (client.instructions or "")
            offered = await client.complete(PromptReference(name="scene"), {"name": "scene_id", "value": ""})
            assert offered.completion.values == ["7"]
            refused = await client.call_tool("get_position", {"object_id": 9})
            assert refused.is_error
            stepped = await client.call_tool("step", {"duration": 0.8})
            assert stepped.structured_content == {
                "sim_time": 0.8,
                "steps": 160,
                "lab_time_left": 3599.2,
                "calls_left": None,
                "results": None,
            }
            await client.call_tool("answer", {"answer": 1})
            assert (await client.call_tool("step", {"duration": 1})).is_error
            with pytest.raises(MCPError, match="cannot be changed"):
                await client.get_prompt("scene", {"scene_id": "8"})


def test_stdout_carries_protocol_lines_only(command: Command, tmp_path: Path) -> None:
    calls = [
        ("apply_force", {"object_id": 1, "force_vector": [1e6, 1e6, 1e6]}),
        ("step", {"duration": 1}),
        ("step", {"duration": "x"}),
        ("create_objects", {"name": "p", "pos": [0, 0, 3], "density": 1e-5, "rgba": [1, 1, 1, 1], "radius": 1e-3}),
    ]
    requests = [
        *({"method": "tools/call", "params": {"name": name, "arguments": arguments}} for name, arguments in calls),
        {"method": "no/such/method", "params": {}},
    ]
    hello = {
        "method": "initialize",
        "params": {
            "protocolVersion": "2025-06-18",
            "capabilities": {},
            "clientInfo": {"name": "test", "version": "1"},
        },
    }
    with subprocess.Popen(
        command("--scene", "7", "--log-level", "debug"),
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        cwd=tmp_path,
        text=True,
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        answers = []
        for number, request in enumerate([hello, *requests]):
            process.stdin.write(json.dumps({"jsonrpc": "2.0", "id": number, **request}) + "\n")
            process.stdin.flush()
            answers.append(json.loads(process.stdout.readline()))
            if number == 0:
                process.stdin.write('{"jsonrpc": "2.0", "method": "notifications/initialized"}\n')
        rest, errors = process.communicate(timeout=300)
    assert rest == ""
    assert [message["id"] for message in answers] == list(range(len(answers)))
    assert all(message["jsonrpc"] == "2.0" for message in answers)
    assert "Traceback" not in errors
    assert process.returncode == 0
    assert not list(tmp_path.iterdir())  # no MUJOCO_LOG.TXT either


BROKEN_XML = "<mujoco><worldbody><body name='object_1'><geom size='-1'/></body></worldbody></mujoco>"


def broken(pack: dict[str, Any], xml: str, fault: str) -> tuple[dict[str, Any], str]:
    if fault == "no task":
        pack["metadata"] = {"scene_name": "x", "problem_type": "calculation"}
    elif fault == "no such body":
        pack["objects"]["object_77"] = {"name": "x", "object_id": "77"}
    elif fault == "not XML":
        xml = "<mujoco>"
    else:
        xml = BROKEN_XML
    return pack, xml


@pytest.mark.parametrize(
    ("fault", "word"),
    [("no task", "metadata.task"), ("no such body", "object_77"), ("not XML", "compile"), ("not a model", "compile")],
)
def test_an_unusable_pack_ends_with_one_sentence_on_stderr_and_exit_code_2(
    write_pack: WritePack,
    pack: dict[str, Any],
    xml: str,
    capsys: pytest.CaptureFixture[str],
    fault: str,
    word: str,
) -> None:
    folder = write_pack(*broken(pack, xml, fault))
    assert main(["--scene", "7", "--scenes-dir", str(folder)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("physment-mcp: ")
    assert err.count("\n") == 1
    assert word in err


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--scene", "8"], "no scene 8; the scenes here are 7"),
        (["--scene", "7", "--scenes-dir", "/no/such/folder"], "no such folder"),
        (["--scenes-dir", "/no/such/folder"], "no such folder"),
        (["serve", "--scenes-dir", "/no/such/folder"], "no such folder"),
        (["serve", "--host", "0.0.0.0"], "loopback"),
        (["serve", "--host", "192.168.1.5"], "loopback"),
    ],
)
def test_an_impossible_start_ends_with_one_sentence_on_stderr_and_exit_code_2(
    write_pack: WritePack,
    pack: dict[str, Any],
    xml: str,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    word: str,
) -> None:
    folder = write_pack(pack, xml)
    given = arguments if "--scenes-dir" in arguments else [*arguments, "--scenes-dir", str(folder)]
    assert main(given) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert word in err


@pytest.mark.parametrize(
    "arguments",
    [
        ["--scene", "seven"],
        ["--seed", "x"],
        ["run"],
        ["serve", "--max-episodes", "0"],
        ["serve", "--idle-timeout", "nan"],
    ],
)
def test_bad_usage_ends_with_exit_code_2(capsys: pytest.CaptureFixture[str], arguments: list[str]) -> None:
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert err.startswith("physment-mcp: ")


def test_the_versions_are_those_of_the_package_and_of_the_engine(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["--version"])
    assert stopped.value.code == 0
    assert capsys.readouterr().out == f"physment-mcp {__version__}, MuJoCo {mujoco.__version__}\n"


def test_a_scene_that_cannot_be_served_ends_the_process(command: Command) -> None:
    ended = subprocess.run(command("--scene", "999999"), capture_output=True, text=True, timeout=300, check=False)
    assert ended.returncode == 2
    assert ended.stdout == ""
    assert ended.stderr.startswith("physment-mcp: ")
    assert ended.stderr.count("\n") == 1
