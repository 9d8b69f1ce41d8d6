"""`physment-eval play N`: a person solves a scene in the terminal. The episode is saved and graded as any other."""

import argparse
import contextlib
import functools
import signal
import socket
import sys
from collections.abc import Awaitable, Callable, Generator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from types import ModuleType

import anyio
import anyio.to_thread
import uvicorn
from rich.console import Console
from rich.markdown import Markdown

from evaluator.agents.browser.app import app
from evaluator.agents.browser.player import BrowserAgent, PageState
from evaluator.agents.human import HumanAgent
from evaluator.answers.keys import KeyRing
from evaluator.commands.base import (
    Commands,
    count_of,
    folder_to_write,
    listening,
    open_page,
    page_token,
    port,
    run_async,
    scene_id,
    seed,
)
from evaluator.commands.finishing import report_on
from evaluator.commands.terminal import printable
from evaluator.episode.connect import connect
from evaluator.episode.loop import play_episode
from evaluator.episode.player import Agent
from evaluator.episode.toolbox import Toolboxes, shows_views, view_now
from evaluator.errors import InfrastructureError, UsageError
from evaluator.records.episode import Episode, EpisodeKey, Outcome, Verdict
from evaluator.records.run import Plan
from evaluator.scores.scored_episode import ScoredEpisode
from evaluator.scores.scoring import grade_run
from evaluator.store.run_folder import RunFolder
from evaluator.study.integrity import seal_note
from evaluator.study.provenance import run_record, server_record
from evaluator.study.selection import parse_scenes
from scenes import PackFiles, reference_of

_LINGER_S = 1.0
"""Longest time for the page to request the verdict [s]."""
_LEAVING = (signal.SIGINT, signal.SIGTERM)


async def play_on_page(
    listener: socket.socket,
    token: str,
    play: Callable[[PageState], Awaitable[Episode]],
    verdict: Callable[[Episode], str],
) -> None:
    """Serve the page while a person plays an episode on it. Ctrl-C ends the episode as if the person left the page.

    Args:
        listener: Listening socket on which the page is served.
        token: First segment of the page's path.
        play: Plays the episode.
        verdict: Records and grades the episode and returns its result as text; called in a thread.
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
        # The server ends open requests when it stops; leaving the block ends the wait for signals.
        await anyio.sleep(0.2)
        tasks.cancel_scope.cancel()


async def _leave_when_signalled(page: PageState) -> None:
    # Windows event loops do not support signal receivers.
    with contextlib.suppress(NotImplementedError), anyio.open_signal_receiver(*_LEAVING) as signals:
        async for _ in signals:
            page.leave()


class _Server(uvicorn.Server):
    """A uvicorn server without signal handlers. The command handles signals, because it first records the episode."""

    @contextlib.contextmanager
    def capture_signals(self) -> Generator[None]:
        """Override that installs no handlers."""
        yield


_PLAY = """\
Solve a scene yourself, with the tools and the budget of any agent: a human baseline.

  physment-eval play 7
  physment-eval play 21 --seed 3 --budget 10
  physment-eval play 7 --web                  in the browser: the scene in three dimensions, tools as forms

Type help at the prompt. The episode is saved as a run of the agent `human` and graded. Leaving after the first
iteration is recorded as an episode without an answer; leaving before it leaves nothing behind.
"""


def add(commands: Commands) -> None:
    """Declare `play`."""
    play = commands.add_parser(
        "play",
        description=_PLAY,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    play.set_defaults(run=_play)
    play.add_argument("scene", type=scene_id, metavar="N", help="which scene")
    play.add_argument("--seed", type=seed, default=0, metavar="S", help="variant of the scene (default 0: as written)")
    play.add_argument("--budget", type=count_of("iterations"), default=20, metavar="N", help="iterations (default 20)")
    play.add_argument("--server", default="stdio", metavar="S", help="as in run (default stdio)")
    play.add_argument("--scenes-dir", type=Path, metavar="DIR", help="folder of scene packs (default: the suite)")
    play.add_argument("--out", type=folder_to_write, metavar="DIR", help="run folder (default runs/TIME-human)")
    play.add_argument(
        "--web", action="store_true", help="play in the browser, on a page for this machine and one person alone"
    )
    play.add_argument("--port", type=port, default=0, help="port of the page (default: any free one)")
    play.add_argument("--no-open", action="store_true", help="print the address of the page, and open no browser")


def _play(args: argparse.Namespace) -> int:
    (files,) = parse_scenes(reference_of(args.scene), args.scenes_dir)
    keys = KeyRing(args.scenes_dir)
    keys.key(args.scene, args.seed)
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S")
    folder = RunFolder(args.out or Path("runs") / f"{stamp}-human")
    folder.create(resume=False)
    console = Console()
    try:
        if args.web:
            _play_on_page(args, files, folder, functools.partial(_finish, folder, keys, console))
        else:
            agent = HumanAgent(_Terminal(console))
            _finish(folder, keys, console, run_async(functools.partial(_episode, args, files, folder, agent)))
    except BaseException:
        _remove_if_empty(folder)
        raise
    return 0


def _finish(folder: RunFolder, keys: KeyRing, console: Console, episode: Episode) -> str:
    """Record and grade an episode; returns its result as text. An episode without a turn is not recorded."""
    if episode.outcome is Outcome.AGENT_ERROR and not episode.turns:
        _remove_if_empty(folder)
        console.print("\nNothing was done, and nothing is saved.")
        return "nothing was done, and nothing is saved"
    folder.append_episode(episode)
    graded = grade_run(folder, keys)
    report_on(folder, graded.rows, keys, seal_note(folder))
    (row,) = graded.rows
    console.print(f"\n{_verdict(row)}", markup=False, highlight=False)
    console.print(f"run folder: {folder.path}   report: {folder.report_file}", highlight=False, soft_wrap=True)
    return _verdict(row)


def _play_on_page(
    args: argparse.Namespace, files: PackFiles, folder: RunFolder, verdict: Callable[[Episode], str]
) -> None:
    """Let the person play in the browser.

    Raises:
        UsageError: The port is taken.
    """
    token = page_token()
    with listening("127.0.0.1", args.port) as listener:
        address = f"http://127.0.0.1:{listener.getsockname()[1]}/{token}/"
        print(f"play at {address} (Ctrl-C leaves)", flush=True)
        if not args.no_open:
            open_page(address)

        async def play(page: PageState) -> Episode:
            return await _episode(args, files, folder, BrowserAgent(page), page)

        run_async(lambda: play_on_page(listener, token, play, verdict))


async def _episode(
    args: argparse.Namespace, files: PackFiles, folder: RunFolder, agent: Agent, page: PageState | None = None
) -> Episode:
    """Let the person play. `run.json` is written only if the person took a turn.

    Args:
        args: Parsed command line.
        files: Pack of the scene.
        folder: Folder of the run's records.
        agent: Agent that passes on the person's calls.
        page: State of the web page, which receives the views; None in the terminal. Views are not recorded.

    Raises:
        UsageError: `--server` names no server that can be reached.
    """
    key = EpisodeKey(scene=args.scene, seed=args.seed, agent="human", budget=args.budget)
    plan = Plan(scenes=(args.scene,), agents=("human",), budgets=(args.budget,), seeds=(args.seed,))
    declared = () if page is None else (shows_views(),)
    async with contextlib.AsyncExitStack() as stack:
        laboratory = await stack.enter_async_context(connect(args.server, args.scenes_dir, declared=declared))
        try:
            client = await stack.enter_async_context(laboratory.open(args.scene, args.seed))
        except InfrastructureError as error:
            raise UsageError(str(error)) from error
        record = run_record(plan, [files], await server_record(client, args.server))
        toolboxes = None if page is None else Toolboxes(look=page.look)
        if page is not None:
            page.view = await view_now(client)
        episode = await play_episode(agent, client, key, record.versions_of(args.scene), toolboxes)
    if episode.turns:
        folder.write_run(record)
    return episode


def _verdict(row: ScoredEpisode) -> str:
    spent = f"{len(row.episode.turns)} of {row.key.budget} iteration{'s' * (row.key.budget != 1)}"
    if row.is_correct:
        return f"Correct, in {spent}."
    forgiven = " (correct in another form)" if row.grade.normalised is Verdict.CORRECT else ""
    return f"Not correct{forgiven}, in {spent}: {row.grade.reason}"


def _remove_if_empty(folder: RunFolder) -> None:
    with contextlib.suppress(OSError):
        folder.path.rmdir()


def _readline() -> ModuleType | None:
    """The `readline` module; None if the platform has none."""
    try:
        import readline  # noqa: PLC0415 - some platforms have none, and only a terminal needs it
    except ImportError:
        return None
    return readline


@dataclass(slots=True)
class _Terminal:
    """Standard input and output, with completion on a terminal."""

    console: Console
    words: Sequence[str] = ()
    editing: ModuleType | None = field(init=False)

    def __post_init__(self) -> None:
        self.editing = _readline() if sys.stdin.isatty() else None
        if self.editing is not None:
            self.editing.set_completer(self.complete)
            self.editing.set_completer_delims(" \t;=,[")
            self.editing.parse_and_bind("tab: complete")

    def show(self, text: str) -> None:
        """Print plain text."""
        self.console.print(printable(text, keep="\n"), markup=False, highlight=False, soft_wrap=True)

    def show_page(self, markdown: str) -> None:
        """Print Markdown, rendered if the output is a terminal."""
        text = printable(markdown, keep="\n")
        if self.console.is_terminal:
            self.console.print(Markdown(text))
        else:
            self.show(text)

    def ask(self, prompt: str, words: Sequence[str]) -> str:
        """Read a line. Meanwhile Ctrl-C raises KeyboardInterrupt, which the handler of the event loop would prevent."""
        self.words = words
        previous = signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            return input(prompt)
        finally:
            signal.signal(signal.SIGINT, previous)

    def complete(self, text: str, state: int) -> str | None:
        """Completer for readline: the completion number `state` of a word."""
        matching = [word for word in self.words if word.startswith(text)]
        return f"{matching[state]} " if state < len(matching) else None
