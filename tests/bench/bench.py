"""Speed as ratios measured in one run: `make bench`.

Each row times both sides alternately in many rounds, and gives the median of the ratios. A ratio above its aim is
marked but is no failure, because machines differ and other processes disturb the measurement.
"""

import contextlib
import json
import logging
import statistics
import subprocess
import sys
import time
from collections.abc import AsyncGenerator, Awaitable, Callable
from pathlib import Path
from xml.sax.saxutils import quoteattr

import anyio
import httpx
import mujoco
from bare_server import bare_server
from mcp import Client, StdioServerParameters
from rich.console import Console
from rich.table import Table

from evaluator.protocols.text import parse_reply
from evaluator.quantities.spoken import spoken_numbers
from physment_mcp import open_episode
from physment_mcp.scene import Scene, load_scene
from physment_mcp.session import Session
from physment_mcp.tools.calls import call_async

HERE = Path(__file__).parent
SCENE = 7
Timed = Callable[[], Awaitable[float]]
Reader = Callable[[str], object]

_BOX = '<body name="object_{0}" pos="{1} 0 {2}"><joint type="free"/><geom type="box" size=".1 .1 .1"/></body>'
_BOXES = "".join(_BOX.format(i, 0.01 * i, 0.3 + 0.3 * i) for i in range(1, 9))
STACK = f'<mujoco><option timestep="0.005"/><worldbody><geom type="plane" size="5 5 .1"/>{_BOXES}</worldbody></mujoco>'
_LAW = '[{"on": "object_1", "let": {"v": "hypot(vx, vy)"}, "force": ["-0.001*v*vx", "-0.001*v*vy", "0"]}]'
STACK_WITH_LAW = STACK.replace("<world", f"<custom><text name='laws' data={quoteattr(_LAW)}/></custom><world")


def numbers_stated(text: str) -> int:
    """How many numbers a text states."""
    return sum(1 for _ in spoken_numbers(text))


READERS: dict[Reader, tuple[str, ...]] = {
    parse_reply: ('[{"tool":"a"},', '{"a": /* }', "[{'a", "```json {'tool':x} ```"),
    numbers_stated: ("1 ", "(1,", "1 m/s/s*"),
}


async def compare(ours: Timed, theirs: Timed, rounds: int) -> tuple[float, float, float]:
    """Median times [s] of both sides and the median of the ratios, after one round to warm up."""
    await ours()
    await theirs()
    pairs = [(await ours(), await theirs()) for _ in range(rounds)]
    ratios = [our_time / their_time for our_time, their_time in pairs]
    return (
        statistics.median(our_time for our_time, _ in pairs),
        statistics.median(their_time for _, their_time in pairs),
        statistics.median(ratios),
    )


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


async def tool_calls() -> AsyncGenerator[tuple[str, float, float, float, float]]:
    """Time a reading through each transport, compared with a server that does nothing."""
    async with Client(open_episode(SCENE).server()) as mine, Client(bare_server()) as bare:
        yield "tool call, in memory", *await compare(calling(mine, 200), calling(bare, 200), 15), 1.25
    async with stdio("-m", "physment_mcp", "--scene", str(SCENE)) as mine, stdio(str(HERE / "bare_server.py")) as bare:
        yield "tool call, stdio", *await compare(calling(mine, 100), calling(bare, 100), 15), 1.25
    async with (
        listening("-m", "physment_mcp", "serve", "--port", "0") as host,
        listening(str(HERE / "bare_server.py"), "http") as address,
        httpx.AsyncClient(base_url=host) as http,
    ):
        url = (await http.post("/episodes", json={"scene": SCENE})).json()["mcp_url"]
        async with Client(url) as mine, Client(address) as bare:
            yield "tool call, host", *await compare(calling(mine, 50), calling(bare, 50), 15), 1.25

        async def opening() -> float:
            start = time.perf_counter()
            for _ in range(20):
                await http.post("/episodes", json={"scene": SCENE})
            return (time.perf_counter() - start) / 20

        await opening()
        times = [await opening() for _ in range(10)]
        yield (
            "open an episode in the warm host",
            statistics.median(times),
            0.005,
            statistics.median(times) / 0.005,
            1.0,
        )


async def stepping(what: str, mjcf: str, aim: float) -> tuple[str, float, float, float, float]:
    """Time ten simulated seconds of eight boxes in a session, compared with the engine alone, without laws."""
    scene = Scene(load_scene(SCENE).public.model_copy(update={"objects": ()}), mjcf)
    model = mujoco.MjModel.from_xml_string(STACK)

    async def ours() -> float:
        session = Session(scene)
        start = time.perf_counter()
        await call_async(session, "step", {"duration": 10.0})
        return time.perf_counter() - start

    async def theirs() -> float:
        data = mujoco.MjData(model)
        start = time.perf_counter()
        mujoco.mj_step(model, data, 2000)
        return time.perf_counter() - start

    return f"{what}, against mj_step(nstep)", *await compare(ours, theirs, 21), aim


async def starting() -> tuple[str, float, float, float, float]:
    """Time from starting the process to its first reply, compared with importing mcp and mujoco."""
    hello = json.dumps(
        {
            "jsonrpc": "2.0",
            "id": 1,
            "method": "initialize",
            "params": {
                "protocolVersion": "2025-06-18",
                "capabilities": {},
                "clientInfo": {"name": "bench", "version": "1"},
            },
        }
    )

    async def ours() -> float:
        return _until_line([sys.executable, "-m", "physment_mcp", "--scene", str(SCENE)], hello)

    async def theirs() -> float:
        code = "import mcp.server.lowlevel, mcp.server.stdio, mujoco; print('ready', flush=True); input()"
        return _until_line([sys.executable, "-c", code], "")

    return "start of the stdio process, against its imports", *await compare(ours, theirs, 11), 1.15


async def long_texts() -> AsyncGenerator[tuple[str, float, float, float, float]]:
    """Texts made to hold up whoever reads what an agent wrote: one of twice the length, against one of the length.

    That the counted work grows in proportion to the length is a test; it does not see what one call into C costs.
    """
    for read, pieces in READERS.items():
        for piece in pieces:

            def reading(length: int, read: Reader = read, piece: str = piece) -> Timed:
                text = piece * (length // len(piece))

                async def timed() -> float:
                    start = time.process_time()
                    read(text)
                    return time.process_time() - start

                return timed

            yield f"{read.__name__}, twice {piece!r}", *await compare(reading(20_000), reading(10_000), 9), 2.3


def _until_line(command: list[str], first: str) -> float:
    start = time.perf_counter()
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        if first:
            process.stdin.write(first + "\n")
            process.stdin.flush()
        assert process.stdout.readline()
        taken = time.perf_counter() - start
        process.stdin.write("\n")
        process.stdin.close()
        process.wait()
    return taken


async def main() -> None:
    """Measure everything and print a table."""
    logging.disable(logging.INFO)
    table = Table(title="Ratios, medians of rounds measured side by side", box=None)
    for title in ("what", "ours ms", "against ms", "ratio", "aim"):
        table.add_column(title, justify="left" if title == "what" else "right")
    rows = [row async for row in tool_calls()]
    rows.append(await stepping("step(10) of a session", STACK, 1.05))
    rows.append(await stepping("step(10) of a session with a law", STACK_WITH_LAW, 1.2))
    rows.append(await starting())
    rows += [row async for row in long_texts()]
    for what, mine, other, ratio, aim in rows:
        mark = "" if ratio <= aim else "  above"
        table.add_row(what, f"{1000 * mine:.3f}", f"{1000 * other:.3f}", f"{ratio:.3f}", f"≤ {aim:g}{mark}")
    Console().print(table)


if __name__ == "__main__":
    anyio.run(main)
