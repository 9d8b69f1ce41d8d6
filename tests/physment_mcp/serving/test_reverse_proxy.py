"""Tests two hosts behind nginx, with the configuration of `docs/how-to/run-a-host.md`: requests reach their episode."""

import json
import re
import shutil
import socket
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Generator
from contextlib import ExitStack, contextmanager

import httpx
import httpx2
import pytest
from mcp import Client
from mcp.client.streamable_http import streamable_http_client

from tests.builders.paths import DOCS

NGINX = shutil.which("nginx") or shutil.which("nginx", path="/usr/sbin:/sbin")
pytestmark = pytest.mark.skipif(NGINX is None, reason="nginx is not installed (on Debian: apt install nginx-light)")

NAMES = {8001: "east", 8002: "west"}
"""Port in the documented configuration → prefix of the host there."""
MAIN = """pid {folder}/nginx.pid;
error_log {folder}/error.log;
events {{}}
http {{
    access_log off;
    client_body_temp_path {folder}/body;
    proxy_temp_path {folder}/proxy;
    fastcgi_temp_path {folder}/fastcgi;
    uwsgi_temp_path {folder}/uwsgi;
    scgi_temp_path {folder}/scgi;
    {site}
}}
"""


def documented() -> str:
    """The configuration on the page."""
    page = (DOCS / "how-to" / "run-a-host.md").read_text(encoding="utf-8")
    return page.split("```nginx\n")[1].split("```")[0]


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as found:
        return int(found.getsockname()[1])


@contextmanager
def running(command: list[str]) -> Generator[subprocess.Popen[str]]:
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process
        finally:
            process.terminate()


def accepts(port: int) -> bool:
    with socket.socket() as tried:
        return tried.connect_ex(("127.0.0.1", port)) == 0


@pytest.fixture(scope="module")
def proxy(tmp_path_factory: pytest.TempPathFactory) -> Generator[str]:
    """The URL of nginx in front of two hosts."""
    folder, site = tmp_path_factory.mktemp("nginx"), documented()
    with ExitStack() as processes:
        for written, name in NAMES.items():
            command = [sys.executable, "-m", "physment_mcp", "serve", "--port", "0", "--id-prefix", name]
            host = processes.enter_context(running(command))
            assert host.stdout is not None
            port = json.loads(host.stdout.readline())["listening"].rpartition(":")[2]
            site = site.replace(f"127.0.0.1:{written}", f"127.0.0.1:{port}")
        port = free_port()
        site = site.replace("listen 8000;", f"listen 127.0.0.1:{port};")
        configuration = folder / "nginx.conf"
        configuration.write_text(MAIN.format(folder=folder, site=site), encoding="utf-8")
        assert NGINX is not None
        processes.enter_context(running([NGINX, "-e", "stderr", "-c", str(configuration), "-g", "daemon off;"]))
        deadline = time.monotonic() + 20
        while not accepts(port) and time.monotonic() < deadline:
            time.sleep(0.05)
        yield f"http://127.0.0.1:{port}"


def opened(proxy: str) -> dict[str, str]:
    reply = httpx.post(f"{proxy}/episodes", json={"scene": 7, "max_calls": 9})
    assert reply.status_code == 201, reply.text
    return reply.json()


async def test_calls_reach_the_host_of_their_episode(proxy: str) -> None:
    episodes = [opened(proxy) for _ in range(6)]
    hosts = Counter(episode["episode_id"].partition(".")[0] for episode in episodes)
    assert hosts == {"east": 3, "west": 3}
    for steps, episode in enumerate(episodes, 1):
        assert episode["mcp_url"].startswith(f"{proxy}/episodes/")
        times = list[float]()
        async with httpx2.AsyncClient(trust_env=False) as http:
            for _ in range(steps):
                async with Client(streamable_http_client(episode["mcp_url"], http_client=http)) as client:
                    result = await client.call_tool("step", {"duration": 0.1})
                assert result.structured_content is not None
                times.append(result.structured_content["sim_time"])
        assert times == pytest.approx([0.1 * number for number in range(1, steps + 1)])


def test_the_log_and_the_end_of_an_episode_reach_its_host(proxy: str) -> None:
    for episode in (opened(proxy), opened(proxy)):
        token = {"Authorization": f"Bearer {episode['owner_token']}"}
        address = f"{proxy}/episodes/{episode['episode_id']}"
        assert httpx.get(f"{address}/calls", headers=token).json()["calls"] == []
        assert httpx.delete(address, headers=token).status_code == 204
        assert httpx.get(f"{address}/calls", headers=token).status_code == 404


def test_a_body_that_is_too_large_is_refused(proxy: str) -> None:
    assert httpx.post(f"{proxy}/episodes", content=b" " * 70_000).status_code == 413


def test_the_page_starts_hosts_with_the_prefixes_that_its_proxy_knows() -> None:
    page = (DOCS / "how-to" / "run-a-host.md").read_text(encoding="utf-8")
    for port, name in NAMES.items():
        assert f"serve --port {port} --id-prefix {name}" in page
        assert re.search(rf"/episodes/{name}\\\.\s+127\.0\.0\.1:{port};", documented())
