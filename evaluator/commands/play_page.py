"""The page of `physment-eval play --web`: served while a person plays there, until the page has shown the verdict."""

import contextlib
import functools
import signal
import socket
from collections.abc import Awaitable, Callable, Generator

import anyio
import anyio.to_thread
import uvicorn

from evaluator.agents.browser.app import app
from evaluator.agents.browser.player import PageState
from evaluator.records.episode import Episode

_LINGER_S = 1.0
"""How long the page may take to ask for the verdict [s]."""
_LEAVING = (signal.SIGINT, signal.SIGTERM)


async def play_on_page(
    listener: socket.socket,
    token: str,
    play: Callable[[PageState], Awaitable[Episode]],
    verdict: Callable[[Episode], str],
) -> None:
    """Serve the page while an episode is played there. Ctrl-C is as if the person left.

    Args:
        listener: Where the page is served.
        token: First part of its path.
        play: Plays the episode.
        verdict: Records and grades the episode, and says how it ended; runs in a thread.
    """
    page = PageState()
    config = uvicorn.Config(
        app(page, token), log_config=None, log_level="warning", lifespan="off", timeout_graceful_shutdown=1
    )
    server = _Server(config)
    async with anyio.create_task_group() as tasks:
        tasks.start_soon(functools.partial(server.serve, sockets=[listener]))
        tasks.start_soon(_leave_when_signalled, page)
        episode = await play(page)
        page.end(await anyio.to_thread.run_sync(verdict, episode))
        await page.told(_LINGER_S)
        server.should_exit = True
        # Open requests of the page end with the server, and the wait for signals with the block.
        await anyio.sleep(0.2)
        tasks.cancel_scope.cancel()


async def _leave_when_signalled(page: PageState) -> None:
    # Windows has no such receiver.
    with contextlib.suppress(NotImplementedError), anyio.open_signal_receiver(*_LEAVING) as signals:
        async for _ in signals:
            page.leave()


class _Server(uvicorn.Server):
    """Leaves signals to the command, which records an episode before it ends."""

    @contextlib.contextmanager
    def capture_signals(self) -> Generator[None]:
        """Nothing."""
        yield
