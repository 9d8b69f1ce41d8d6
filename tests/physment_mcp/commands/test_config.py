"""Tests that the printed configuration is valid JSON in the client's format and starts the laboratory."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import anyio
import pytest
from mcp import Client, StdioServerParameters

from physment_mcp.commands.program import main

CLIENTS = {"claude-desktop": "mcpServers", "claude-code": "mcpServers", "vscode": "servers", "cursor": "mcpServers"}


def configured(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, Any]:
    assert main(["config", *words]) == 0
    out, err = capsys.readouterr()
    assert err.count("\n") == 1  # it says where to put the configuration
    written = json.loads(out)
    (servers,) = written.values()
    assert list(servers) == ["physment"]
    assert list(written) == [CLIENTS[words[0]]]
    return servers["physment"]


def test_each_client_is_configured_in_its_own_form(capsys: pytest.CaptureFixture[str]) -> None:
    servers = {client: configured(capsys, client, "--scene", "7") for client in CLIENTS}
    transports = {client: server.pop("type", None) for client, server in servers.items()}
    assert transports == dict.fromkeys(CLIENTS, "stdio") | {"claude-desktop": None}
    assert all(server == servers["cursor"] for server in servers.values())


async def test_a_pasted_configuration_starts_the_laboratory(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    server = configured(capsys, "claude-desktop", "--scene", "7", "--seed", "3")
    assert server.keys() == {"command", "args"}
    assert Path(server["command"]).is_absolute()
    with anyio.fail_after(120):
        async with Client(StdioServerParameters(**server, cwd=tmp_path)) as session:
            assert "# Scene: " in (session.instructions or "")
            assert (await session.call_tool("answer", {"answer": 1})).structured_content is not None


async def test_without_a_scene_the_laboratory_starts_idle(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    server = configured(capsys, "claude-desktop")
    assert "--scene" not in server["args"]
    with anyio.fail_after(120):
        async with Client(StdioServerParameters(**server, cwd=tmp_path)) as session:
            assert "No scene is open yet" in (session.instructions or "")
            await session.get_prompt("scene", {"scene_id": "8"})
            (contents,) = (await session.read_resource("physment://scene")).contents
            assert json.loads(contents.text)["scene_id"] == 8


def test_a_folder_of_scenes_is_written_in_full(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine" / "Scene7").mkdir(parents=True)
    monkeypatch.chdir(tmp_path)
    server = configured(capsys, "cursor", "--scene", "7", "--scenes-dir", "mine")
    assert server["args"][-4:] == ["--scene", "7", "--scenes-dir", str(tmp_path / "mine")]


def test_the_configuration_asks_for_pictures_if_wanted(capsys: pytest.CaptureFixture[str]) -> None:
    server = configured(capsys, "cursor", "--scene", "7", "--observations", "rgb")
    assert server["args"][-4:] == ["--scene", "7", "--observations", "rgb"]
    assert "--observations" not in configured(capsys, "cursor", "--observations", "text")["args"]


def test_only_json_is_on_stdout() -> None:
    words = [sys.executable, "-m", "physment_mcp", "--scene", "9", "config", "vscode"]
    done = subprocess.run(words, capture_output=True, text=True, check=True, timeout=300)
    assert json.loads(done.stdout)["servers"]["physment"]["args"][-2:] == ["--scene", "9"]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["cursor", "--scene", "9999"], "no scene 9999"),
        (["emacs"], "emacs is none of claude-desktop, claude-code, vscode, cursor"),
    ],
)
def test_what_cannot_be_configured_is_refused(words: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    code = main(["config", *words])
    out, err = capsys.readouterr()
    assert (code, out) == (2, "")
    assert said in err
