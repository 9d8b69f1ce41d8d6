"""Times a reading through each transport, and the opening of an episode."""

import contextlib
import json
import subprocess
import sys
import time
from collections.abc import AsyncGenerator
from pathlib import Path

import anyio
import httpx
from mcp import Client, StdioServerParameters

from physment_mcp import open_episode
from tests.harness.bench.bare_server import bare_server
from tests.harness.bench.measuring import Row, Timed, against_aim, compare

BARE = str(Path(__file__).with_name("bare_server.py"))
SCENE = 7
OPENING_S = 0.005


def calling(client: Client, calls: int) -> Timed:
    """Measures the time [s] of one `get_velocity`, averaged over some calls."""

    async def timed() -> float:
        start = time.perf_counter()
        for _ in range(calls):
            await client.call_tool("get_velocity", {"object_id": "object_1"})
        return (time.perf_counter() - start) / calls

    return timed


def stdio(*arguments: str) -> Client:
    return Client(StdioServerParameters(command=sys.executable, args=list(arguments)))


@contextlib.asynccontextmanager
async def listening(*arguments: str) -> AsyncGenerator[str]:
    """Start a server process that prints its address first; yields the address."""
    process = subprocess.Popen([sys.executable, *arguments], stdout=subprocess.PIPE, text=True)  # noqa: ASYNC220
    try:
        assert process.stdout is not None
        yield json.loads(await anyio.to_thread.run_sync(process.stdout.readline))["listening"]
    finally:
        process.terminate()
        process.wait()


async def rows() -> AsyncGenerator[Row]:
    """Yield rows that compare each transport with a server whose tool does nothing."""
    async with Client(open_episode(SCENE).server()) as mine, Client(bare_server()) as bare:
        yield await compare("tool call, in memory", calling(mine, 200), calling(bare, 200), 15, 1.25)
    async with stdio("-m", "physment_mcp", "--scene", str(SCENE)) as mine, stdio(BARE) as bare:
        yield await compare("tool call, stdio", calling(mine, 100), calling(bare, 100), 15, 1.25)
    async with (
        listening("-m", "physment_mcp", "serve", "--port", "0") as host,
        listening(BARE, "http") as address,
        httpx.AsyncClient(base_url=host) as http,
    ):
        url = (await http.post("/episodes", json={"scene": SCENE})).json()["mcp_url"]
        async with Client(url) as mine, Client(address) as bare:
            yield await compare("tool call, host", calling(mine, 50), calling(bare, 50), 15, 1.25)

        async def opening() -> float:
            start = time.perf_counter()
            for _ in range(20):
                await http.post("/episodes", json={"scene": SCENE})
            return (time.perf_counter() - start) / 20

        yield await against_aim("open an episode in the warm host, over HTTP", opening, 10, OPENING_S)
