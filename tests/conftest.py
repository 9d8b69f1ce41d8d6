"""Settings and fixtures of all tests: coverage of the core, async backend, web servers, --update-goldens."""

import contextlib
import http.server
import json
import subprocess
import sys
import threading
from collections.abc import Callable, Generator

import pytest
from hypothesis import settings

from tests.builders.paths import ORIGINAL

# The time of an example depends on the machine and its load, so it must not fail a test.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--update-goldens", action="store_true", help="rewrite the golden files instead of comparing with them"
    )


TRACED = (
    "tests/evaluator/answers",
    "tests/evaluator/episode/test_",
    "tests/evaluator/records",
    "tests/evaluator/scores",
    "tests/evaluator/statistics",
    "tests/physment_mcp",
)
"""Prefixes of the paths of tests that run under coverage, because they test modules that pyproject.toml requires to be
covered completely. The tracer makes all Python code up to twice as slow, so the other tests run without it."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if not item.nodeid.startswith(TRACED):
            item.add_marker(pytest.mark.no_cover)
    if not all((ORIGINAL / part).is_dir() for part in ("Scenes", "logs")):
        reason = "the published packs and logs are not here; PHYSMENT_ORIGINAL names the folder that holds them"
        for item in items:
            if item.get_closest_marker("published"):
                item.add_marker(pytest.mark.skip(reason=reason))


@pytest.fixture(scope="session")
def update_goldens(request: pytest.FixtureRequest) -> bool:
    return bool(request.config.getoption("--update-goldens"))


@pytest.fixture(scope="session")
def anyio_backend() -> str:
    return "asyncio"


@pytest.fixture(scope="session")
def host_url() -> Generator[str]:
    """Return the address of a host that all tests of a worker process share, because a start takes over a second."""
    command = [sys.executable, "-m", "physment_mcp", "serve", "--port", "0", "--end-with-stdin"]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield json.loads(process.stdout.readline())["listening"]
        process.terminate()


@pytest.fixture
def web_server() -> Callable[..., contextlib.AbstractContextManager[str]]:
    """Starts a web server that gives the same reply to every request; yields its address.

    With `busy`, it first refuses that many requests with status 429 and `Retry-After: 0`.
    """

    @contextlib.contextmanager
    def serving(status: int, body: bytes, busy: int = 0) -> Generator[str]:
        refusals = iter(range(busy))

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                refused = next(refusals, None) is not None
                self.send_response(429 if refused else status)
                if refused:
                    self.send_header("Retry-After", "0")
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            do_GET = do_DELETE = do_POST  # noqa: N815 - named by the base class

            def log_message(self, format: str, *args: object) -> None:  # noqa: A002 - named by the base class
                pass

        with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
            thread = threading.Thread(target=server.serve_forever)
            thread.start()
            try:
                yield f"http://127.0.0.1:{server.server_port}"
            finally:
                server.shutdown()
                thread.join()

    return serving
