"""An episode that a person plays in the terminal or the browser. It is opened, recorded and graded like any other.

`physment-eval play N --web` serves the page of a person, who may play further variants after the first one. A signal
first ends the episodes of the page and then its server.
"""

import contextlib
import functools
import signal
import socket
from collections.abc import AsyncGenerator, Callable, Generator, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import anyio.to_thread
import uvicorn
from mcp import Client
from rich.console import Console
from starlette.types import ASGIApp

from evaluator.agents.browser.app import ABSENT_S, app, hash_of
from evaluator.agents.browser.player import BrowserAgent, Ending, PageState
from evaluator.answers.keys import KeyRing
from evaluator.commands.base import listening, open_page, page_token, run_async
from evaluator.commands.finishing import report_on
from evaluator.episode.connect import connect
from evaluator.episode.loop import play_episode
from evaluator.episode.player import Agent
from evaluator.episode.toolbox import Toolboxes, shows_views, view_now
from evaluator.errors import InfrastructureError, UsageError
from evaluator.records.episode import Episode, EpisodeKey, Outcome, Verdict, Versions
from evaluator.records.run import Plan
from evaluator.scores.scored_episode import ScoredEpisode
from evaluator.scores.scoring import grade_run
from evaluator.store.run_folder import RunFolder
from evaluator.study.integrity import seal_note
from evaluator.study.run_start import run_record, server_record
from scenes import PackError, PackFiles, is_world, list_packs, read_public

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


@dataclass(frozen=True, slots=True)
class PreparedEpisode:
    """An episode that a person will play, with the run folder that records it."""

    files: PackFiles
    seed: int
    folder: RunFolder


@dataclass(frozen=True, slots=True)
class HumanPlay:
    """Settings shared by all episodes that a person plays in one run of the command."""

    server: str
    scenes_dir: Path | None
    budget: int
    keys: KeyRing
    console: Console

    def variant(self, files: PackFiles, seed: int, path: Path) -> PreparedEpisode:
        """Prepare a variant: its key must exist, and its run folder is created.

        Raises:
            UsageError: There is no key for this seed.
            StoreError: The folder holds a run, or cannot be written.
        """
        self.keys.key(files.scene_id, seed)
        folder = RunFolder(path)
        folder.create(resume=False)
        return PreparedEpisode(files, seed, folder)

    async def play(self, variant: PreparedEpisode, player: Agent | PageState) -> Episode:
        """Let the person play. `run.json` is written only if the person took a turn.

        Args:
            variant: The prepared episode.
            player: The agent that passes on the person's calls from the terminal, or the state of the web page.

        Raises:
            UsageError: The server cannot be reached.
        """
        scene, seed = variant.files.scene_id, variant.seed
        key = EpisodeKey(scene=scene, seed=seed, agent="human", budget=self.budget)
        plan = Plan(scenes=(scene,), agents=("human",), budgets=(self.budget,), seeds=(seed,))
        declared = (shows_views(),) if isinstance(player, PageState) else ()
        async with contextlib.AsyncExitStack() as stack:
            laboratory = await stack.enter_async_context(connect(self.server, self.scenes_dir, declared=declared))
            try:
                client = await stack.enter_async_context(laboratory.open(scene, seed))
            except InfrastructureError as error:
                raise UsageError(str(error)) from error
            record = run_record(plan, [variant.files], await server_record(client, self.server))
            if isinstance(player, PageState):
                episode = await play_on_page(player, client, key, variant.files, record.versions_of(scene))
            else:
                episode = await play_episode(player, client, key, record.versions_of(scene))
        if episode.turns:
            variant.folder.write_run(record)
        return episode

    def finish(self, variant: PreparedEpisode, episode: Episode) -> Ending:
        """Record and grade an episode, and print its result. An episode without a turn is not recorded."""
        folder = variant.folder
        if episode.outcome is Outcome.AGENT_ERROR and not episode.turns:
            remove_if_empty(folder)
            self.console.print("\nNothing was done, and nothing is saved.")
            return Ending("Nothing was done, and nothing is saved.")
        folder.append_episode(episode)
        graded = grade_run(folder, self.keys)
        report_on(folder, graded.rows, self.keys, seal_note(folder))
        (row,) = graded.rows
        self.console.print(f"\n{_verdict(row)}", markup=False, highlight=False)
        self.console.print(f"run folder: {folder.path}   report: {folder.report_file}", highlight=False, soft_wrap=True)
        return Ending(_verdict(row), row.is_correct, row.record.answer_key, episode.answer, folder.report_file)


async def play_on_page(
    page: PageState, client: Client, key: EpisodeKey, files: PackFiles, versions: Versions
) -> Episode:
    """Let a person play an episode on a web page. The views that the page shows are not recorded.

    Args:
        page: State of the page.
        client: A client connected to a fresh session of the scene, which receives views.
        key: Key of the episode.
        files: Pack of the scene.
        versions: Versions of software and pack to record with the episode.
    """
    public = read_public(files)
    limits = {} if public.limits is None else public.limits.model_dump(exclude_none=True)
    page.rules = {"limits": limits, "steps": [step.model_dump() for step in public.steps]}
    page.view = await view_now(client)
    return await play_episode(BrowserAgent(page), client, key, versions, Toolboxes(look=page.look))


@contextlib.contextmanager
def kept_if_used(folder: RunFolder) -> Generator[None]:
    """Remove a run folder if the block fails before anything was recorded."""
    try:
        yield
    except BaseException:
        remove_if_empty(folder)
        raise


def remove_if_empty(folder: RunFolder) -> None:
    """Remove a run folder in which nothing was recorded."""
    with contextlib.suppress(OSError):
        folder.path.rmdir()


def _verdict(row: ScoredEpisode) -> str:
    spent = f"{len(row.episode.turns)} of {row.key.budget} iteration{'s' * (row.key.budget != 1)}"
    if row.is_correct:
        return f"Correct, in {spent}."
    forgiven = " (correct in another form)" if row.grade.normalised is Verdict.CORRECT else ""
    return f"Not correct{forgiven}, in {spent}: {row.grade.reason}"


def play_in_browser(play: HumanPlay, first: PreparedEpisode, port: int, *, opens: bool) -> None:
    """Let the person play in the browser, until the page is closed or Ctrl-C.

    Args:
        play: Settings of the command.
        first: The first variant.
        port: Port of the page; 0 for any free one.
        opens: Whether to open the page in a browser.

    Raises:
        UsageError: The port is taken, or the server cannot be reached.
    """
    token = page_token()
    with listening("127.0.0.1", port) as listener:
        address = f"http://127.0.0.1:{listener.getsockname()[1]}/{token}/"
        print(f"play at {address} (Ctrl-C leaves)", flush=True)
        if opens:
            open_page(address)
        run_async(lambda: _serve(listener, token, play, first))


async def _serve(listener: socket.socket, token: str, play: HumanPlay, first: PreparedEpisode) -> None:
    page = PageState()
    async with serving(app({hash_of(token): page}), listener, page.close):
        await _play_all(page, play, first)


async def _play_all(page: PageState, play: HumanPlay, first: PreparedEpisode) -> None:
    """Play the first variant, and then those that the person chooses on the page."""
    names = _folders(first.folder.path)
    variant = first
    while True:
        with kept_if_used(variant.folder):
            episode = await play.play(variant, page)
        ending = await anyio.to_thread.run_sync(play.finish, variant, episode)
        following = _following(variant.files, play.scenes_dir)
        page.end(_with_choices(ending, variant, following))
        choice = await page.choice(ABSENT_S)
        if choice is None:
            return
        files, seed = (following or variant.files, 0) if choice == "scene" else (variant.files, variant.seed + 1)
        variant = play.variant(files, seed, next(names))
        page.begin()


def _with_choices(ending: Ending, variant: PreparedEpisode, following: PackFiles | None) -> Ending:
    choices = {"seed": f"seed {variant.seed + 1}"}
    if following is not None:
        choices["scene"] = f"scene {following.scene_id}, {read_public(following).name}"
    return replace(ending, choices=choices)


def _following(files: PackFiles, scenes_dir: Path | None) -> PackFiles | None:
    """Return the pack with the next id; None after the last one, and for a world."""
    if is_world(files.scene_id):
        return None
    with contextlib.suppress(PackError):
        return next((found for found in list_packs(scenes_dir) if found.scene_id > files.scene_id), None)
    return None


def _folders(first: Path) -> Iterator[Path]:
    """Yield unused names of further run folders next to the first one: `NAME-2`, `NAME-3` and so on."""
    number = 2
    while True:
        path = first.with_name(f"{first.name}-{number}")
        if not path.exists():
            yield path
        number += 1
