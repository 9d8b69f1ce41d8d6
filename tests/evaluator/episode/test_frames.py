"""Tests of images in results (`--observations rgb`): what agents receive, and what a run folder stores."""

import json
from pathlib import Path
from typing import Any

import mcp_types as types
import pytest
from mcp import Client
from mcp.server.lowlevel import Server

from evaluator.agents.reference import ScriptedAgent
from evaluator.episode.connect import connect
from evaluator.episode.hosts import LocalHost
from evaluator.episode.loop import play_episode
from evaluator.errors import InfrastructureError, StoreError, UsageError
from evaluator.records.episode import Episode, Exchange, Frame
from evaluator.records.run import Plan
from evaluator.store.run_folder import RunFolder
from evaluator.study.shards import merge
from physment_mcp.serving.views import Painter
from tests.builders.frames import open_painter, watched_scene
from tests.builders.records import LOOK, STEP, VERSIONS, answer, episode, episode_key, returned, turn

PNG = b"\x89PNG\r\n\x1a\n"


painter = pytest.fixture(scope="module")(open_painter)


async def test_the_pictures_of_results_reach_the_record(painter: Painter) -> None:
    async with watched_scene(painter) as client:
        script = ScriptedAgent("script", {None: ((STEP, LOOK), (STEP, answer(1)))})
        played = await play_episode(script, client, episode_key(), VERSIONS)
    (step, look), (later, _) = (turn.exchanges for turn in played.turns)
    assert look.frames == ()
    assert step.frames[0].png.startswith(PNG)
    assert step.frames[0].name != later.frames[0].name  # the ball has fallen on


async def test_a_picture_that_is_no_base64_is_a_failure_of_the_server() -> None:
    async def list_tools(*_: Any) -> types.ListToolsResult:
        return types.ListToolsResult(tools=[types.Tool(name="step", input_schema={"type": "object"})])

    async def call_tool(*_: Any) -> types.CallToolResult:
        return types.CallToolResult(content=[types.ImageContent(data="*", mime_type="image/png")])

    async def get_prompt(*_: Any) -> types.GetPromptResult:
        return types.GetPromptResult(messages=[])

    server = Server("broken", on_list_tools=list_tools, on_call_tool=call_tool, on_get_prompt=get_prompt)
    async with Client(server) as client:
        script = ScriptedAgent("script", {None: ((STEP,),)})
        with pytest.raises(InfrastructureError, match="is not base64"):
            await play_episode(script, client, episode_key(), VERSIONS)


def with_frames(scene: int, *contents: bytes) -> Episode:
    exchanges = tuple(returned("step").model_copy(update={"frames": (Frame.of(content),)}) for content in contents)
    return episode(turn("", *exchanges), key=episode_key(scene))


def test_a_run_folder_keeps_each_picture_once(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "run")
    folder.create(resume=False)
    folder.append_episode(with_frames(7, PNG + b"start", PNG + b"end"))
    folder.append_episode(with_frames(8, PNG + b"start"))
    kept = {file.name: file.read_bytes() for file in folder.frames_folder.iterdir()}
    names = [Frame.of(PNG + content).name for content in (b"start", b"end")]
    assert kept == {f"{names[0]}.png": PNG + b"start", f"{names[1]}.png": PNG + b"end"}
    (first, _) = folder.episodes().values()
    assert [exchange.frames for exchange in first.turns[0].exchanges] == [(Frame(name=name),) for name in names]
    assert b"PNG" not in folder.episodes_file.read_bytes()


def test_records_without_pictures_are_written_as_before() -> None:
    assert "frames" not in json.loads(Exchange(call=STEP, returned=True).model_dump_json())
    assert "observations" not in json.loads(Plan(scenes=(7,), agents=("x",)).model_dump_json())


def test_pictures_are_merged_with_their_episodes(tmp_path: Path, run_folder_of: Any) -> None:
    parts = [run_folder_of(tmp_path / "a", with_frames(7, PNG)), run_folder_of(tmp_path / "b", with_frames(8, PNG))]
    target = RunFolder(tmp_path / "whole")
    merge(parts, target)
    assert [file.read_bytes() for file in target.frames_folder.iterdir()] == [PNG]
    next(parts[0].frames_folder.iterdir()).unlink()
    with pytest.raises(StoreError, match="cannot be read"):
        merge(parts, RunFolder(tmp_path / "again"))


@pytest.fixture
def run_folder_of() -> Any:
    from evaluator.records.run import RunRecord, ServerRecord

    def made(path: Path, played: Episode) -> RunFolder:
        folder = RunFolder(path)
        folder.create(resume=False)
        plan = Plan(scenes=(7, 8), agents=("x",), observations="rgb")
        server = ServerRecord(option="host")
        folder.write_run(RunRecord(created_at="2026-01-01T00:00:00+00:00", plan=plan, server=server))
        folder.append_episode(played)
        return folder

    return made


@pytest.mark.parametrize("server", ["http://127.0.0.1:9", "my-server --scene {scene}"])
async def test_pictures_are_asked_only_of_servers_that_we_start(server: str) -> None:
    with pytest.raises(UsageError, match="--observations rgb is for servers that we start"):
        async with connect(server, None, "rgb"):
            pass


@pytest.mark.usefixtures("painter")
async def test_our_servers_draw_if_they_are_asked_to() -> None:
    for server in ("stdio", "host"):
        async with connect(server, None, "rgb") as laboratory, laboratory.open(7, 0) as client:
            result = await client.call_tool("step", {"duration": 0.1})
        assert [part.type for part in result.content] == ["text", "image"]
    assert LocalHost().observations == "text"
