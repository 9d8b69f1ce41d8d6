"""Tests of access to a host: tokens, host names, pages of other sites, closed episodes, links to other files."""

import contextlib
from collections.abc import AsyncGenerator, Callable
from pathlib import Path
from typing import Any

import anyio
import httpx
import pytest
from mcp import Client, MCPError
from mcp.client.streamable_http import streamable_http_client

from physment_mcp.commands.program import main
from physment_mcp.contract.addresses import is_loopback
from physment_mcp.serving.episode_server import EpisodeServer
from tests.builders.hosts import FOREIGN_HOSTS
from tests.builders.laboratory import OpenHost, WritePack

BASE = "http://127.0.0.1"
OURS = {"Authorization": "Bearer ours"}
STRANGERS: tuple[dict[str, str], ...] = (
    {},
    {"Authorization": "Bearer theirs"},
    {"Authorization": "Bearer "},
    {"Authorization": "ours"},
    {"Authorization": "Basic ours"},
    {"Authorization": "Bearer ours ours"},
)


@pytest.fixture
def inside(write_pack: WritePack, pack: dict[str, Any], xml: str) -> Callable[..., Any]:
    """Start a host in this process, and connect to it without sockets."""
    folder = write_pack(pack, xml)

    @contextlib.asynccontextmanager
    async def opened(base: str = BASE, **options: Any) -> AsyncGenerator[tuple[EpisodeServer, httpx.AsyncClient]]:
        host = EpisodeServer(scenes_dir=folder, **options)
        app = host.app()
        async with (
            app.router.lifespan_context(app),
            httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url=base) as http,
        ):
            yield host, http

    return opened


@contextlib.asynccontextmanager
async def playing(http: httpx.AsyncClient, url: str, mode: str = "auto") -> AsyncGenerator[Client]:
    in_process: Any = http  # the SDK's own HTTP client has another name and the same methods
    async with Client(streamable_http_client(url, http_client=in_process), mode=mode) as client:  # pyright: ignore[reportArgumentType] - a mode
        yield client


async def open_episode(http: httpx.AsyncClient, **wanted: int) -> dict[str, str]:
    reply = await http.post("/episodes", json={"scene": 7, **wanted}, headers=OURS)
    assert reply.status_code == 201, reply.text
    return reply.json()


@pytest.mark.parametrize("exposed", [False, True])
async def test_a_host_with_a_token_opens_episodes_only_with_it(inside: OpenHost, exposed: bool) -> None:
    async with inside(token="ours", exposed=exposed) as (host, http):
        for headers in STRANGERS:
            refused = await http.post("/episodes", json={"scene": 7}, headers=headers)
            assert refused.status_code == 401
            assert refused.headers["www-authenticate"] == "Bearer"
            assert "bearer token" in refused.json()["error"]
            assert "ours" not in refused.text
        assert not host._episodes
        assert "ours" not in repr(host)
        opened = await open_episode(http)
        assert "ours" not in str(opened)
        assert (await http.get("/healthz")).status_code == 200  # balancers have no token
        for headers in STRANGERS if exposed else STRANGERS[1:]:  # unless exposed, the URL alone is enough
            assert (await http.delete(f"/episodes/{opened['episode_id']}", headers=headers)).status_code == 401
        assert (await http.delete(f"/episodes/{opened['episode_id']}", headers=OURS)).status_code == 204


async def test_an_exposed_host_requires_its_token_with_every_request(inside: OpenHost) -> None:
    async with inside(token="ours", exposed=True) as (_, http):
        mine = await open_episode(http)
        for path in (mine["mcp_url"], "/episodes/unknown/mcp"):
            for headers in STRANGERS:
                for method in ("POST", "GET", "DELETE"):
                    assert (await http.request(method, path, json={}, headers=headers)).status_code == 401
        http.headers.update(OURS)
        async with playing(http, mine["mcp_url"]) as client:
            assert not (await client.call_tool("step", {"duration": 0.1})).is_error


async def test_an_episode_with_a_call_limit_is_played_with_its_url_alone(inside: OpenHost) -> None:
    async with inside(token="ours", exposed=True) as (_, http):
        theirs = await open_episode(http, max_calls=5)
        async with playing(http, theirs["mcp_url"]) as client:
            assert not (await client.call_tool("step", {"duration": 0.1})).is_error
        for path, method in ((f"/episodes/{theirs['episode_id']}", "DELETE"), ("/episodes", "POST")):
            assert (await http.request(method, path)).status_code == 401
        wrong = {"Authorization": "Bearer theirs"}
        assert (await http.post(theirs["mcp_url"], json={}, headers=wrong)).status_code == 401
        calls = f"/episodes/{theirs['episode_id']}/calls"
        assert (await http.get(calls)).status_code == 401
        for good in ("ours", theirs["owner_token"]):
            assert (await http.get(calls, headers={"Authorization": f"Bearer {good}"})).status_code == 200


async def test_on_a_local_host_an_episode_is_played_with_its_url_alone(inside: OpenHost) -> None:
    async with inside(token="ours") as (_, http):
        opened = await open_episode(http)
        async with playing(http, opened["mcp_url"]) as client:
            assert not (await client.call_tool("step", {"duration": 0.1})).is_error
        wrong = {"Authorization": "Bearer theirs"}
        assert (await http.post(opened["mcp_url"], json={}, headers=wrong)).status_code == 401


@pytest.mark.parametrize("mode", ["auto", "legacy"])
@pytest.mark.parametrize("known", [False, True])
async def test_an_episode_that_is_gone_says_how_to_open_one(inside: OpenHost, mode: str, known: bool) -> None:
    async with inside() as (_, http):
        opened = await open_episode(http)
        url = opened["mcp_url"] if known else f"{BASE}/episodes/unknown/mcp"

        async def close() -> None:
            assert (await http.delete(f"/episodes/{opened['episode_id']}")).status_code == 204

        if not known:
            await close()
        async with playing(http, url, mode) as client:
            if known:  # the episode is closed while a client is connected
                assert not (await client.call_tool("step", {"duration": 0.1})).is_error
                await close()
            for tool, arguments in (("step", {"duration": 0.1}), ("answer", {"answer": 1}), ("fly", {})):
                result = await client.call_tool(tool, arguments)
                assert result.is_error
                assert 'open one with POST /episodes {"scene": 7, "seed": 0}' in result.content[0].text
                assert "mcp_url" in result.content[0].text
                assert result.meta is not None
                assert result.meta["physment/gone"] is True
            assert len((await client.list_tools()).tools) == 26
            with pytest.raises(MCPError, match="POST /episodes"):
                await client.get_prompt("scene", {"scene_id": "7"})
            assert '"gone"' in (await client.read_resource("physment://episode")).contents[0].text


@pytest.mark.parametrize("mode", ["auto", "legacy"])
async def test_a_client_that_stays_connected_does_not_keep_an_unused_episode(inside: OpenHost, mode: str) -> None:
    async with inside(idle_timeout_s=0.2) as (host, http):
        opened = await open_episode(http)
        with anyio.fail_after(120):
            async with playing(http, opened["mcp_url"], mode) as client:
                while host._episodes:
                    await anyio.lowlevel.checkpoint()
                assert (await client.call_tool("step", {"duration": 0.1})).is_error


@pytest.mark.parametrize("name", FOREIGN_HOSTS)
async def test_a_request_for_another_name_is_refused(inside: OpenHost, name: str) -> None:
    async with inside() as (host, http):
        for method, path in (("POST", "/episodes"), ("GET", "/healthz"), ("POST", "/episodes/x/mcp")):
            refused = await http.request(method, path, json={"scene": 7}, headers=[(b"Host", name.encode("latin-1"))])
            assert refused.status_code == 400
            assert "does not go by the name" in refused.json()["error"]
        assert not host._episodes


@pytest.mark.parametrize("names", [("localhost", "evil.example"), ("evil.example", "localhost"), ("localhost",) * 2])
async def test_a_request_with_two_names_is_refused(inside: OpenHost, names: tuple[str, str]) -> None:
    async with inside() as (host, http):
        refused = await http.post("/episodes", json={"scene": 7}, headers=[("Host", name) for name in names])
        assert refused.status_code == 400
        assert not host._episodes


async def test_a_refusal_repeats_little_of_a_long_request(inside: OpenHost) -> None:
    long = "x" * 20_000
    async with inside() as (_, http):
        asked = [
            await http.get("/healthz", headers={"Host": long}),
            await http.get("/healthz", headers={"Origin": f"http://{long}"}),
            await http.post("/episodes", json={"scene": 7, long: 1}),
            await http.post("/episodes", json={"scene": 7, "\U000e0001" * 2000: 1}),
            await http.get(f"/episodes/{long}/calls"),
            await http.delete(f"/episodes/{long}"),
            await http.get(f"/{long}"),
        ]
        assert [reply.status_code for reply in asked] == [400, 403, 400, 400, 404, 404, 404]
        assert max(len(reply.text) for reply in asked) < 300


@pytest.mark.parametrize("name", ["127.0.0.1:8000", "localhost", "localhost:1", "LOCALHOST:1", "[::1]:8000", "[::1]"])
async def test_a_request_to_this_machine_is_served(inside: OpenHost, name: str) -> None:
    async with inside() as (_, http):
        assert (await http.get("/healthz", headers={"Host": name})).status_code == 200


async def test_a_host_answers_to_its_address_and_to_the_names_it_was_given(inside: OpenHost) -> None:
    options = {"token": "ours", "exposed": True, "names": ("Lab.example",)}
    async with inside("http://10.1.2.3", **options) as (_, http):
        for name, status in (
            ("10.1.2.3:80", 200),
            ("lab.example:443", 200),
            ("10.1.2.4", 400),
            ("lab.example.org", 400),
        ):
            assert (await http.get("/healthz", headers={"Host": name})).status_code == status
        opened = await http.post("/episodes", json={"scene": 7}, headers=OURS | {"Host": "lab.example"})
        assert opened.json()["mcp_url"].startswith("http://lab.example/episodes/")


@pytest.mark.parametrize(
    ("origin", "status"),
    [
        ("http://localhost:6274", 200), ("https://127.0.0.1", 200), ("http://[::1]:3000", 200),
        ("http://evil.example", 403), ("null", 403), ("", 403), ("http://localhost.evil.example", 403),
        ("http://localhost@evil.example", 403), ("file://", 403), ("http://evil.example@localhost", 403),
        ("localhost", 403), ("//localhost", 403), ("http:localhost", 403), ("http://[::1]evil", 403),
        ("http://localhost/", 403), ("http://localhost.", 403), ("HTTP://LOCALHOST:80", 200),
    ],
)  # fmt: skip
async def test_a_page_of_another_site_is_refused(inside: OpenHost, origin: str, status: int) -> None:
    async with inside() as (host, http):
        assert (await http.get("/healthz", headers={"Origin": origin})).status_code == status
        opened = await http.post("/episodes", json={"scene": 7}, headers={"Origin": origin})
        assert opened.status_code == {200: 201, 403: 403}[status]
        assert bool(host._episodes) == (status == 200)


@pytest.mark.parametrize(
    ("address", "expected"),
    [
        ("127.0.0.1", True), ("127.0.0.2", True), ("::1", True), ("[::1]", True), ("localhost", True),
        ("0.0.0.0", False), ("::", False), ("192.168.1.5", False), ("lab.example", False), ("", False),
    ],
)  # fmt: skip
def test_loopback_is_known_by_its_address(address: str, expected: bool) -> None:
    assert is_loopback(address) is expected


@pytest.mark.parametrize(
    ("options", "word"),
    [
        (["--host", "0.0.0.0"], "served without a token"),
        (["--host", "::"], "served without a token"),
        (["--host", "lab.example"], "--token-env"),
        (["--host", "0.0.0.0", "--token-env", "PHYSMENT_NO_SUCH_VARIABLE"], "holds no token"),
        (["--token-env", "PHYSMENT_EMPTY"], "holds no token"),
    ],
)
def test_an_exposed_host_does_not_start_without_a_token(
    options: list[str], word: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PHYSMENT_EMPTY", " ")
    assert main(["serve", *options]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("physment-mcp: ")
    assert err.count("\n") == 1
    assert word in err


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--open", "{"], "Invalid JSON"),
        (["--open", '{"scene": 9999}'], "no scene 9999"),
    ],
)
def test_an_episode_that_cannot_be_opened_at_the_start_is_refused_before_anything_is_served(
    options: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["serve", "--port", "0", *options]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert says in err
    assert err.count("\n") == 1


@pytest.mark.parametrize("scene", ["../Scene7", "/etc/passwd", "Scene7", "7/../8", "", None, [7], {"path": "x"}])
async def test_a_scene_is_a_number_and_never_a_path(inside: OpenHost, scene: Any) -> None:
    async with inside() as (host, http):
        refused = await http.post("/episodes", json={"scene": scene})
        assert refused.status_code == 400
        assert refused.json()["error"].startswith("scene: ")
        assert not host._episodes


@pytest.mark.parametrize("what", ["Scene8", "scene8.json", "scene8.xml"])
async def test_a_link_out_of_the_folder_of_scenes_is_refused(
    write_pack: WritePack, pack: dict[str, Any], xml: str, tmp_path: Path, what: str
) -> None:
    folder = write_pack(pack, xml)
    outside = write_pack(pack, xml, 8) / "Scene8"
    moved = tmp_path / "elsewhere"
    if what == "Scene8":
        outside.rename(moved)
        outside.symlink_to(moved)
    else:
        (outside / what).rename(moved)
        (outside / what).symlink_to(moved)
    host = EpisodeServer(scenes_dir=folder, token="ours")
    app = host.app()
    async with (
        app.router.lifespan_context(app),
        httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url=BASE, headers=OURS) as http,
    ):
        refused = await http.post("/episodes", json={"scene": 8})
        assert refused.status_code == 404
        assert "a link leads out of the folder of scene packs" in refused.json()["error"]
        assert (await http.post("/episodes", json={"scene": 7})).status_code == 201


@pytest.mark.parametrize(
    "planted",
    ['<include file="/etc/passwd"/>', "<asset><mesh name='m' file='../m.obj'/></asset>", '<include\nfile = "x"/>'],
)
async def test_a_model_that_names_a_file_is_refused(
    write_pack: WritePack, pack: dict[str, Any], xml: str, planted: str
) -> None:
    host = EpisodeServer(scenes_dir=write_pack(pack, xml.replace("<worldbody>", planted + "<worldbody>")), token="ours")
    app = host.app()
    async with (
        app.router.lifespan_context(app),
        httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url=BASE, headers=OURS) as http,
    ):
        refused = await http.post("/episodes", json={"scene": 7})
        assert refused.status_code == 404
        assert "names another file" in refused.json()["error"]
