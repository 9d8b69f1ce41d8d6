"""Figures of the structure: lines of Python, components and the imports between them, files of a run and of a call.

python -m tests.harness.structure
"""

import ast
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from tests.builders.paths import ROOT
from tests.test_architecture import all_sources, imports_between

PACKAGES = ("physment_mcp", "evaluator")
RUN = ["--server", "host", "--scenes", "7", "--agent", "reference", "--workers", "1"]


def lines_of_python() -> int:
    """Lines of all Python files that git tracks."""
    done = subprocess.run(["git", "ls-files", "*.py"], cwd=ROOT, capture_output=True, text=True, check=True)
    return sum(len((ROOT / name).read_text(encoding="utf-8").splitlines()) for name in done.stdout.split())


def imports_per_100_lines(package: str) -> float:
    """Import statements per 100 lines of code: without blank lines, comments and docstrings."""
    statements = lines = 0
    for path in (ROOT / package).rglob("*.py"):
        source = path.read_text(encoding="utf-8")
        tree = ast.parse(source)
        text = {
            number
            for node in ast.walk(tree)
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)
            for number in range(node.lineno, (node.end_lineno or node.lineno) + 1)
        }
        statements += sum(isinstance(node, ast.Import | ast.ImportFrom) for node in ast.walk(tree))
        rows = enumerate(source.splitlines(), start=1)
        lines += sum(
            number not in text and bool(row.strip()) and not row.strip().startswith("#") for number, row in rows
        )
    return 100 * statements / lines


def files_of_a_run(words: Sequence[str]) -> list[str]:
    """Return the evaluator's files whose functions a run calls in the command's process, in order of first call."""
    with tempfile.TemporaryDirectory() as place:
        command = [sys.executable, "-c", _TRACED, *words, "--out", f"{place}/run"]
        done = subprocess.run(command, cwd=place, capture_output=True, text=True, check=True)
    return [Path(line).relative_to(ROOT).as_posix() for line in done.stderr.splitlines() if line.startswith(str(ROOT))]


_TRACED = """
import inspect, sys, threading
from evaluator.commands.program import main
seen = {}
def note(frame, event, argument):
    if event == "call":
        code = frame.f_code
        if "/evaluator/" in code.co_filename and code.co_flags & inspect.CO_OPTIMIZED:
            seen.setdefault(code.co_filename)
threading.setprofile(note)
sys.setprofile(note)
main(sys.argv[1:])
sys.setprofile(None)
print(*seen, sep="\\n", file=sys.stderr)
"""


def files_of_a_call() -> list[str]:
    """Return the host's files whose functions one `apply_force` over HTTP calls, in order of first call.

    The client repeats a call that it has made before, on an open connection.
    """
    done = subprocess.run([sys.executable, "-c", _TRACED_HOST], cwd=ROOT, capture_output=True, text=True, check=True)
    return [Path(line).relative_to(ROOT).as_posix() for line in done.stderr.splitlines() if line.startswith(str(ROOT))]


_TRACED_HOST = """
import asyncio, inspect, io, json, os, sys, threading
import httpx2
from mcp import Client
from mcp.client.streamable_http import streamable_http_client
from physment_mcp.commands.program import main

seen, tracing = {}, threading.Event()

def note(frame, event, argument):
    if event == "call" and tracing.is_set():
        code = frame.f_code
        if "/physment_mcp/" in code.co_filename and code.co_flags & inspect.CO_OPTIMIZED:
            seen.setdefault(code.co_filename)

async def play(address):
    async with httpx2.AsyncClient() as http:
        opened = (await http.post(address + "/episodes", json={"scene": 7})).json()
        async with Client(streamable_http_client(opened["mcp_url"], http_client=http), cache=None) as client:
            for trace in (False, True):
                if trace:
                    tracing.set()
                done = await client.call_tool("apply_force", {"object_id": "object_1", "force_vector": [1, 0, 0]})
                assert not done.is_error, done
            await asyncio.sleep(0.2)
            tracing.clear()

class Printed(io.StringIO):
    def write(self, text):
        if "listening" in text:
            threading.Thread(target=client, args=[json.loads(text)["listening"]]).start()
        return len(text)

def client(address):
    sys.setprofile(None)
    code = 1
    try:
        asyncio.run(play(address))
        print(*seen, sep="\\n", file=sys.stderr, flush=True)
        code = 0
    finally:
        os._exit(code)

sys.stdout = Printed()
threading.setprofile(note)
sys.setprofile(note)
main(["serve", "--port", "0"])
"""


def main() -> int:
    """Print the figures."""
    print(f"{lines_of_python()} lines of Python")
    for package in PACKAGES:
        graph = imports_between(all_sources(), package)
        arrows = sum(len(below) for below in graph.values())
        share = imports_per_100_lines(package)
        print(f"{package}: {len(graph)} components, {arrows} arrows, {share:.1f} imports per 100 lines of code")
    found = files_of_a_run(RUN)
    print(f"a run of one scene calls functions of {len(found)} files of evaluator:", *found, sep="\n  ")
    found = files_of_a_call()
    print(f"a call over HTTP calls functions of {len(found)} files of physment_mcp:", *found, sep="\n  ")
    return 0


if __name__ == "__main__":
    sys.exit(main())
