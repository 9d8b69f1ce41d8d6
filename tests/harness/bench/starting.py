"""Times the start of programs, and compares it with the time of their imports alone."""

import json
import resource
import subprocess
import sys
import time
from collections.abc import AsyncGenerator

from tests.harness.bench.measuring import Row, Timed, against_aim, compare

SCENE = 7
HELP_S = 0.5
_HELLO = json.dumps(
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
_IMPORTS = ("mcp", "mujoco", "physment_mcp", "physment_mcp.session", "physment_mcp.serving.server", "evaluator")


async def rows() -> AsyncGenerator[Row]:
    """Yield rows: start to first reply, `--help`, and imports."""

    async def ours() -> float:
        return _until_line([sys.executable, "-m", "physment_mcp", "--scene", str(SCENE)], _HELLO)

    async def theirs() -> float:
        code = "import mcp.server.lowlevel, mcp.server.stdio, mujoco; print('ready', flush=True); input()"
        return _until_line([sys.executable, "-c", code], "")

    yield await compare("start of the stdio process, against its imports", ours, theirs, 11, 1.15)
    for module in ("evaluator", "physment_mcp"):
        yield await against_aim(f"{module} --help, processor time", _busy("-m", module, "--help"), 5, HELP_S)
    bare = _busy("-c", "import mcp, mujoco")
    for name in _IMPORTS:
        yield await compare(f"import {name}, against mcp and mujoco", _busy("-c", f"import {name}"), bare, 5, 1.5)


def _busy(*words: str) -> Timed:
    """Measures the processor time [s] of a Python process."""

    async def timed() -> float:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, *words], stdout=subprocess.DEVNULL, check=True)  # noqa: ASYNC221 - nothing else runs
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime

    return timed


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
