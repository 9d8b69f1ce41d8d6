"""Model providers on loopback, on one server for all tests."""

import contextlib
import itertools
import socket
import threading
import time
from collections.abc import Callable, Iterator

import pytest
import uvicorn

from tests.builders.providers import Anthropic, Dialect, Google, OpenAI, OpenRouter, Port, Service

OpenService = Callable[[Dialect], Service]


@pytest.fixture(scope="session")
def open_service() -> Iterator[OpenService]:
    """Opens providers on one server, which runs in its own thread."""
    port = Port()
    # asyncio switches off Nagle's algorithm, which delays half a reply by 40 ms, only if TCP is named as the protocol.
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listener.bind(("127.0.0.1", 0))
    server = uvicorn.Server(uvicorn.Config(port, lifespan="off", log_level="critical", ws="none"))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]}, daemon=True)
    thread.start()
    numbers = itertools.count()

    def opened(dialect: Dialect) -> Service:
        name = f"test{next(numbers)}"
        service = Service(dialect, f"http://127.0.0.1:{listener.getsockname()[1]}/{name}")
        port.services[name] = service
        return service

    for _ in range(500):
        if server.started:
            break
        time.sleep(0.01)
    yield opened
    server.should_exit = True
    server.force_exit = True
    thread.join(10)
    with contextlib.suppress(OSError):
        listener.close()


@pytest.fixture(params=[OpenAI(), Anthropic(), Google()], ids=lambda dialect: dialect.name)
def service(request: pytest.FixtureRequest, open_service: OpenService) -> Service:
    """A provider of each kind in turn."""
    return open_service(request.param)


@pytest.fixture
def openai(open_service: OpenService) -> Service:
    return open_service(OpenAI())


@pytest.fixture
def openrouter(open_service: OpenService) -> Service:
    return open_service(OpenRouter())


@pytest.fixture
def anthropic(open_service: OpenService) -> Service:
    return open_service(Anthropic())


@pytest.fixture
def google(open_service: OpenService) -> Service:
    return open_service(Google())
