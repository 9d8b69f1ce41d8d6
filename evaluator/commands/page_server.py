"""Serves the browser pages of people who play. A signal first ends their episodes and then the server."""

import contextlib
import functools
import signal
import socket
from collections.abc import AsyncGenerator, Callable, Generator

import anyio
import uvicorn
from starlette.types import ASGIApp

_LEAVING = (signal.SIGINT, signal.SIGTERM)


@contextlib.asynccontextmanager
async def serving(
    application: ASGIApp,
    listener: socket.socket,
    close: Callable[[], object],
    linger_s: float = 1.0,
    most: int | None = None,
) -> AsyncGenerator[None]:
    """Serve an application while the block runs.

    Args:
        application: The ASGI application.
        listener: The listening socket.
        close: Called at Ctrl-C and SIGTERM; it must cause the block to end.
        linger_s: Time for open requests of the pages after the block [s].
        most: Largest number of connections; further ones get status 503. None for no limit.
    """
    config = uvicorn.Config(
        application,
        log_config=None,
        log_level="warning",
        lifespan="off",
        timeout_graceful_shutdown=1,
        limit_concurrency=most,
        server_header=False,
    )
    server = _Server(config)
    async with anyio.create_task_group() as tasks:
        tasks.start_soon(functools.partial(server.serve, sockets=[listener]))
        tasks.start_soon(_call_when_signalled, close)
        yield
        await anyio.sleep(linger_s)
        server.should_exit = True
        # The server ends open requests when it stops; leaving the block ends the wait for signals.
        await anyio.sleep(0.2)
        tasks.cancel_scope.cancel()


async def _call_when_signalled(close: Callable[[], object]) -> None:
    # Windows event loops do not support signal receivers.
    with contextlib.suppress(NotImplementedError), anyio.open_signal_receiver(*_LEAVING) as signals:
        async for _ in signals:
            close()


class _Server(uvicorn.Server):
    """A uvicorn server without signal handlers. The command handles signals, because it first records the episodes."""

    @contextlib.contextmanager
    def capture_signals(self) -> Generator[None]:
        """Override that installs no handlers."""
        yield
