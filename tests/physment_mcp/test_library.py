"""Tests of the laboratory as a library: its public names, and an episode in this process."""

import ast
import inspect
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import anyio
import pytest
from mcp import Client
from mcp.types import TextContent

import physment_mcp
from physment_mcp import EpisodeOver, OpenEpisode, RefusedCall, SceneError, open_episode
from physment_mcp.serving.server import published_tools
from tests.builders.public_names import check_public_names

SCRIPT: list[tuple[str, dict[str, Any]]] = [
    ("apply_force", {"object_id": "object_1", "force_vector": [1, 2, 3]}),
    ("step", {"duration": 2.5}),
    ("create_objects", {"name": "probe", "pos": [9, 9, 9], "density": 500, "rgba": [1, 0, 0, 1]}),
    ("get_acceleration", {"object_id": 2}),
    ("get_parameters", {"object_id": "object_6"}),
    ("find_objects", {}),
    ("step", {"duration": 0.005}),
    ("get_velocity", {"object_id": "probe"}),
    ("answer", {"answer": [1, "two"]}),
]


@pytest.fixture
def folder(write_pack: Callable[..., Path], pack: dict[str, Any], xml: str) -> Path:
    return write_pack(pack, xml)


@pytest.fixture
def episode(folder: Path) -> OpenEpisode:
    return open_episode(7, scenes_dir=folder)


def test_the_public_names_are_sorted_documented_and_importable() -> None:
    check_public_names(physment_mcp)


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'no_such_name'"):
        _ = physment_mcp.no_such_name  # pyright: ignore[reportUnknownVariableType]


def test_nothing_inside_the_package_imports_its_public_names() -> None:
    """An import of the public names would make a module depend on `library`, and imports would be circular."""
    root = Path(str(physment_mcp.__file__)).parent
    importing = [
        path.relative_to(root)
        for path in root.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if (isinstance(node, ast.ImportFrom) and node.module == "physment_mcp")
        or (isinstance(node, ast.Import) and any(alias.name == "physment_mcp" for alias in node.names))
    ]
    assert importing == []


def test_importing_the_package_imports_no_library() -> None:
    code = "import sys, physment_mcp; print(*{'mujoco', 'numpy', 'pydantic', 'mcp', 'anyio'} & sys.modules.keys())"
    assert subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout == "\n"


def test_an_episode_in_process_needs_no_mcp() -> None:
    code = (
        "import sys, physment_mcp; physment_mcp.open_episode(7).call('step', duration=1); print('mcp' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True).stdout == "False\n"


async def test_an_episode_in_process_is_the_episode_that_mcp_serves(episode: OpenEpisode, folder: Path) -> None:
    async with Client(open_episode(7, scenes_dir=folder).server()) as client:
        assert client.instructions == episode.prompt
        for tool, arguments in SCRIPT:
            result = await client.call_tool(tool, arguments)
            assert result.structured_content == episode.call(tool, **arguments)


async def test_a_prompt_with_a_budget_is_the_one_that_mcp_serves(episode: OpenEpisode, folder: Path) -> None:
    async with Client(open_episode(7, scenes_dir=folder).server()) as client:
        served = await client.get_prompt("scene", {"prompting": "one-shot-cot", "budget": "12"})
    assert [message.content for message in served.messages] == [
        TextContent(type="text", text=episode.prompt_for(12, "one-shot-cot"))
    ]
    with pytest.raises(ValueError, match="two-shot"):
        episode.prompt_for(12, "two-shot")


def test_the_tools_are_described_as_mcp_publishes_them(episode: OpenEpisode) -> None:
    assert [(tool.name, tool.description, tool.input_schema, tool.output_schema) for tool in episode.tools] == [
        (tool.name, tool.description, tool.input_schema, tool.output_schema) for tool in published_tools()
    ]


def test_a_changed_description_changes_no_other(episode: OpenEpisode) -> None:
    episode.tools[0].input_schema.clear()
    assert episode.tools[0].input_schema


def test_a_refused_call_changes_nothing(episode: OpenEpisode) -> None:
    before = episode.call("get_position", object_id="object_1")
    with pytest.raises(RefusedCall, match="sealed"):
        episode.call("apply_force", object_id="object_4", force_vector=[1, 0, 0])
    with pytest.raises(RefusedCall, match="there is no tool"):
        episode.call("teleport")
    assert episode.call("get_position", object_id="object_1") == before
    assert episode.calls == 4


def test_a_step_that_blows_up_is_rolled_back(write_pack: Callable[..., Path], pack: dict[str, Any], xml: str) -> None:
    stiff = xml.replace(
        '<joint name="j8" type="hinge" axis="0 1 0"/>',
        '<joint name="j8" type="hinge" axis="0 1 0" stiffness="1e9" springref="1" damping="0"/>',
    )
    episode = open_episode(7, scenes_dir=write_pack(pack, stiff))
    before = episode.call("get_position", object_id="object_8")
    with pytest.raises(RefusedCall, match="rolled back"):
        episode.call("step", duration=60)
    assert episode.call("get_position", object_id="object_8") == before


def test_an_episode_ends_with_its_answer(episode: OpenEpisode) -> None:
    assert (episode.ended, episode.answer) == (False, None)
    episode.call("answer", answer=4.19)
    assert (episode.ended, episode.answer) == (True, 4.19)
    with pytest.raises(EpisodeOver, match="answer has been given"):
        episode.call("step", duration=1)


def test_an_episode_ends_when_its_calls_are_used_up(folder: Path) -> None:
    episode = open_episode(7, max_calls=1, scenes_dir=folder)
    episode.call("step", duration=0.1)
    assert episode.ended
    with pytest.raises(EpisodeOver, match="1 calls are used up"):
        episode.call("answer", answer=1)


def test_a_scene_that_is_not_there_cannot_be_opened(folder: Path) -> None:
    with pytest.raises(SceneError, match="no scene 8"):
        open_episode(8, scenes_dir=folder)


def test_episodes_share_nothing(folder: Path) -> None:
    first, second = open_episode(7, scenes_dir=folder), open_episode(7, scenes_dir=folder)
    first.call("step", duration=1)
    assert second.call("get_position", object_id="object_1")["sim_time"] == 0


async def test_a_call_works_inside_an_event_loop_and_in_a_thread(episode: OpenEpisode) -> None:
    assert episode.call("step", duration=0.5)["steps"] == 100
    assert (await anyio.to_thread.run_sync(lambda: episode.call("step", duration=0.5)))["steps"] == 100


def test_the_public_attributes_hold_nothing_hidden(episode: OpenEpisode) -> None:
    plain = (str, int, bool, type(None))
    public = {name: getattr(episode, name) for name in dir(episode) if not name.startswith("_")}
    values = {name: value for name, value in public.items() if not inspect.ismethod(value)}
    assert values.keys() == {"answer", "calls", "ended", "prompt", "scene_id", "tools"}
    assert all(isinstance(value, plain) for name, value in values.items() if name != "tools")
    assert "ghost" not in repr(values)
    assert "ghost" not in repr(episode)
