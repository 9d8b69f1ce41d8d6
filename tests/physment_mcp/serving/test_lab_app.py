"""Tests of the chat app: the server offers it only to clients that declare support for MCP Apps."""

import json
import re
from collections.abc import Callable
from typing import Any

import pytest
from mcp import Client, MCPError
from mcp.client.extension import advertise

from physment_mcp.contract.names import APP_TYPE, APPS, VIEW, VIEW_URI
from physment_mcp.scene import load_scene
from physment_mcp.serving.resources import APP_URI, SHOWING, app_page
from physment_mcp.serving.server import build_server, published_tools
from physment_mcp.serving.slot import EpisodeSlot
from physment_mcp.session import Session
from physment_mcp.visibility import cached_visibility, visibility_of
from tests.builders.app_client import app_client
from tests.builders.laboratory import OpenHost, WritePack

pytestmark = pytest.mark.anyio

OpenSlot = Callable[..., EpisodeSlot]
CALLS: list[tuple[str, dict[str, Any]]] = [
    ("step", {"duration": 0.1}),
    ("find_objects", {}),
    ("get_position", {"object_id": 1}),
    ("step", {"duration": -1}),
    ("move_object", {"object_id": 1, "x": 0, "y": 0, "z": 2}),
    ("step", {"duration": 0.2}),
]


@pytest.fixture
def slot(pack: dict[str, Any], xml: str, write_pack: WritePack) -> OpenSlot:
    folder = write_pack(pack, xml)

    def opened(**options: Any) -> EpisodeSlot:
        return EpisodeSlot(
            Session(load_scene(7, 0, folder), **options),
            find_visibility=lambda scene: visibility_of(scene, [scene.mjcf]),
        )

    return opened


async def said(client: Client) -> list[str]:
    """Return everything that a client receives from a server, serialised."""
    lists = [await client.list_tools(), await client.list_resources(), await client.list_prompts()]
    results = [await client.call_tool(tool, arguments) for tool, arguments in CALLS]
    return [part.model_dump_json(by_alias=True) for part in (*lists, *results)]


@pytest.mark.parametrize("mode", ["auto", "legacy"])
async def test_a_client_that_shows_apps_gets_the_app_and_what_it_draws(slot: OpenSlot, mode: str) -> None:
    async with app_client(build_server(slot()), mode) as client:
        tools = (await client.list_tools()).tools
        assert [tool.model_copy(update={"meta": None}) for tool in tools] == list(published_tools())
        carrying = {tool.name: tool.meta for tool in tools if tool.meta}
        assert set(carrying) == SHOWING
        assert carrying["step"] == {"ui": {"resourceUri": APP_URI}, "ui/resourceUri": APP_URI}
        listed = {resource.uri: resource for resource in (await client.list_resources()).resources}
        assert listed[APP_URI].mime_type == APP_TYPE
        (page,) = (await client.read_resource(APP_URI)).contents
        assert (page.mime_type, page.text[:15]) == (APP_TYPE, "<!doctype html>")
        results = {tool: await client.call_tool(tool, arguments) for tool, arguments in CALLS}
        view = (results["step"].meta or {})[VIEW]
        assert view["motion"]["times"][0] == 0.1
        assert view["poses"]["object_1"][2] == view["motion"]["poses"]["object_1"][-1][2]
        assert VIEW in (results["find_objects"].meta or {})
        assert VIEW not in (results["get_position"].meta or {})
        (now,) = (await client.read_resource(VIEW_URI)).contents
        assert json.loads(now.text) == {name: part for name, part in view.items() if name != "motion"}


@pytest.mark.parametrize("settings", [None, {}, {"mimeTypes": ["text/plain"]}])
async def test_other_clients_get_the_same_bytes_as_from_a_server_without_the_app(
    slot: OpenSlot, settings: dict[str, Any] | None
) -> None:
    without = slot()
    without._find_visibility = None
    extensions = None if settings is None else [advertise(APPS, settings)]
    async with Client(build_server(without)) as plain, Client(build_server(slot()), extensions=extensions) as other:
        assert await said(other) == await said(plain)
        for uri in (APP_URI, VIEW_URI):
            with pytest.raises(MCPError, match="there is no resource"):
                await other.read_resource(uri)


async def test_an_episode_that_is_played_for_a_score_does_not_offer_it(slot: OpenSlot) -> None:
    async with Client(build_server(slot(max_calls=50))) as plain, app_client(build_server(slot(max_calls=50))) as other:
        assert await said(other) == await said(plain)
        with pytest.raises(MCPError, match="there is no resource"):
            await other.read_resource(VIEW_URI)


async def test_looking_is_no_call_and_is_not_logged(slot: OpenSlot) -> None:
    looked_at, alone = slot(), slot()
    async with app_client(build_server(looked_at)) as client, Client(build_server(alone)) as other:
        for tool, arguments in CALLS:
            await client.read_resource(VIEW_URI)
            seen, told = await client.call_tool(tool, arguments), await other.call_tool(tool, arguments)
            assert (seen.content, seen.structured_content) == (told.content, told.structured_content)
    notes = [[logged.as_note(number) for number, logged in enumerate(one.log.calls)] for one in (looked_at, alone)]
    assert notes[0] == notes[1]
    assert looked_at.session
    assert looked_at.session.calls == len(CALLS)


async def test_a_view_that_cannot_be_made_hides_no_result(slot: OpenSlot, tmp_path: Any) -> None:
    blind = slot()
    blind._find_visibility = cached_visibility(tmp_path)  # a folder without variants
    async with app_client(build_server(blind)) as client:
        result = await client.call_tool("step", {"duration": 0.1})
        assert not result.is_error
        assert VIEW not in (result.meta or {})
        (now,) = (await client.read_resource(VIEW_URI)).contents
        assert json.loads(now.text)["drawing"] == {"bodies": []}


async def test_a_host_offers_it_with_its_folder_of_scenes(inside: OpenHost) -> None:
    async with inside() as (host, _):
        session = Session(load_scene(7, 0, host.scenes_dir))
        assert "object_2" in str(host._find_visibility(session.scene).parts)


def test_the_app_is_one_file_that_runs_only_its_own_script_and_connects_to_nothing() -> None:
    page = app_page().contents[0]
    text: str = page.text  # type: ignore[union-attr]
    assert len(text.encode()) < 1_500_000
    (policy,) = re.findall(r'http-equiv="Content-Security-Policy" content="([^"]+)"', text)
    assert re.sub(r"'sha256-[\w+/=]+'", "HASH", policy).split("; ") == [
        *("default-src 'none'", "script-src HASH", "style-src HASH", "img-src data:", "base-uri 'none'")
    ]
    assert text.count("<script") == text.count("</script>") == 1
    assert re.findall(r'<(?:link|img|script)[^>]*(?:src|href)="', text.split("<script", maxsplit=1)[0]) == []


UNWATCHED = 82
"""A scene with an object that moves and may be read, but is not drawn."""


async def _measured(seed: int, *calls: tuple[str, dict[str, Any]]) -> tuple[list[Any], dict[str, Any]]:
    """Return the results of calls, and the view after them."""
    slot = EpisodeSlot(Session(load_scene(UNWATCHED, seed)), find_visibility=cached_visibility(None))
    async with app_client(build_server(slot)) as client:
        returned = [(await client.call_tool(tool, arguments)).structured_content for tool, arguments in calls]
        view = (await client.read_resource(VIEW_URI)).contents[0]
        return returned, json.loads(view.text)  # type: ignore[union-attr]


async def test_an_object_that_is_not_drawn_is_shown_where_results_placed_it_last() -> None:
    look, push = ("get_position", {"object_id": 1}), ("apply_force", {"object_id": 1, "force_vector": [0, 2, 0]})
    step = ("step", {"duration": 0.3})
    assert "read" not in (await _measured(0, push, step))[1]
    (first, *_), view = await _measured(0, look, push, step, ("get_position", {"object_id": 9}))
    assert view["read"] == {"object_1": {"position": first["position"], "time": 0}}
    (*_, last), view = await _measured(0, look, push, step, look)
    assert view["read"] == {"object_1": {"position": last["position"], "time": last["sim_time"]}}
    assert last["position"] != first["position"]


async def test_what_is_shown_follows_from_what_was_returned_alone() -> None:
    look, push = ("get_position", {"object_id": 1}), ("apply_force", {"object_id": 1, "force_vector": [0, 2, 0]})
    step = ("step", {"duration": 0.3})
    episodes = [await _measured(seed, look, push, step) for seed in (0, 7)]
    assert episodes[0] == episodes[1], "the same results and the same view"
    places = [(await _measured(seed, look, push, step, look))[0][-1]["position"] for seed in (0, 7)]
    assert places[0] != places[1], "though the object is elsewhere"
