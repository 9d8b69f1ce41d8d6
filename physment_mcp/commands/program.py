"""Command line of the laboratory: one episode on stdio, or one of the commands. The only reader of argv."""

import argparse
import contextlib
import gc
import logging
import queue
import sys
import threading
import time
from collections.abc import Sequence
from functools import partial
from typing import NoReturn

import anyio

from physment_mcp.commands import bundle, config, export, fork_server, preview, serve
from physment_mcp.commands.base import common_options, observations, scene_id, timestep, whole_number
from physment_mcp.contract.command_line import SentenceParser
from physment_mcp.errors import SceneError, UsageError
from physment_mcp.version import __version__, engine_version

_WAITING = 1000
"""Length of the queue of log lines; further ones are dropped."""
_LAST_S = 0.5
"""Time for writing the queued lines when the program ends [s]."""
_DESCRIPTION = """\
A physics laboratory over MCP: one MuJoCo scene per episode, 26 typed tools.

Without a command it serves one episode on stdin and stdout, for an MCP client that starts it:
  physment-mcp --scene 7             scene 7, as written
  physment-mcp --scene 7 --seed 3    a variant of it, with other hidden values
  physment-mcp                       starts idle; the MCP prompt `scene` opens a scene
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code: 0 done, 2 usage or a scene that cannot be loaded."""
    # Modules and open episodes are long-lived. With the default threshold of 700 allocations, the garbage collector
    # traverses them so often that a start, and a call on a server with hundreds of episodes, takes a tenth longer.
    gc.set_threshold(10_000, 20, 20)
    try:
        args = parser().parse_args(sys.argv[1:] if argv is None else argv)
        logging.basicConfig(
            handlers=[NonBlockingLog()], level=args.log_level.upper(), format="%(levelname)s %(name)s: %(message)s"
        )
        return args.run(args)
    except (SceneError, UsageError) as error:
        print(f"physment-mcp: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


def parser() -> argparse.ArgumentParser:
    """Build the parser: the options for one episode on stdio, and the commands."""
    words = _Parser(
        "physment-mcp",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        parents=[common_options()],
    )
    words.add_argument("--version", action=_Versions, nargs=0, help="show the versions of this package and of MuJoCo")
    words.add_argument("--scene", type=scene_id, metavar="N", help="scene to open, or world:5:17; default: start idle")
    words.add_argument(
        "--seed", type=whole_number, default=0, metavar="S", help="variant of the scene (default 0: as written)"
    )
    observations(words)
    timestep(words)
    words.set_defaults(run=_stdio)
    commands = words.add_subparsers(metavar="COMMAND")
    for command in (serve, export, config, bundle, preview):
        command.add(commands)
    fork_server.add(commands, main)
    return words


class _Parser(SentenceParser):
    usage_error = UsageError


class _Versions(argparse.Action):
    """Prints the versions and exits. They are looked up only here, because that takes time."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> NoReturn:
        print(f"physment-mcp {__version__}, MuJoCo {engine_version()}")
        parser.exit()


def _stdio(args: argparse.Namespace) -> int:
    from mcp.server.stdio import stdio_server  # noqa: PLC0415

    from physment_mcp.scene import list_scenes, load_scene, scene_ids  # noqa: PLC0415
    from physment_mcp.serving.server import build_server  # noqa: PLC0415
    from physment_mcp.serving.slot import EpisodeSlot  # noqa: PLC0415 - --help need not wait for the engine
    from physment_mcp.serving.views import watching  # noqa: PLC0415
    from physment_mcp.session import Session  # noqa: PLC0415
    from physment_mcp.visibility import cached_visibility  # noqa: PLC0415

    watch, find_visibility = watching(args.observations, args.scenes_dir), cached_visibility(args.scenes_dir)

    def reopen(scene_id: int) -> Session:
        return Session(load_scene(scene_id, args.seed, args.scenes_dir, args.timestep))

    if args.scene is None:
        ids = scene_ids(args.scenes_dir)
        listed = partial(list_scenes, args.scenes_dir)
        slot = EpisodeSlot(
            reopen=reopen, scene_ids=ids, list_scenes=listed, watch=watch, find_visibility=find_visibility
        )
    else:
        slot = EpisodeSlot(reopen(args.scene), watch=watch, find_visibility=find_visibility)
    server = build_server(slot)
    if sys.stdin.isatty():
        print(_waiting(args.scene), file=sys.stderr)

    async def run() -> None:
        async with stdio_server() as (read, write):
            await server.run(read, write, server.create_initialization_options())

    anyio.run(run)
    return 0


def _waiting(scene: int | None) -> str:
    """Return the notice for a person who starts the server in a terminal."""
    tried = 7 if scene is None else scene
    return (
        "physment-mcp: waits for messages of an MCP client on stdin; Ctrl-C ends it. To connect a client, see"
        f" `physment-mcp config --help`; to experiment by hand, use `physment-eval play {tried}`."
    )


class NonBlockingLog(logging.Handler):
    """A log handler that never blocks: a thread writes to standard error, and a full queue drops lines."""

    def __init__(self) -> None:
        super().__init__()
        self._lines: queue.Queue[str] = queue.Queue(_WAITING)
        self._writer: threading.Thread | None = None

    def emit(self, record: logging.LogRecord) -> None:
        """Queue a line, or drop it if the queue is full. `logging` calls this in one thread at a time."""
        if self._writer is None:  # not earlier: a process with threads should not fork
            self._writer = threading.Thread(target=self._write, name="log", daemon=True)
            self._writer.start()
        with contextlib.suppress(queue.Full):
            self._lines.put_nowait(self.format(record) + "\n")

    def close(self) -> None:
        """Wait briefly for the queue to be written. `logging` calls this when the program ends."""
        until = time.monotonic() + _LAST_S
        while self._lines.unfinished_tasks and time.monotonic() < until:
            time.sleep(0.005)
        super().close()

    def _write(self) -> None:
        while True:
            line = self._lines.get()
            with contextlib.suppress(OSError, ValueError):  # nobody reads it any more
                sys.stderr.write(line)
                sys.stderr.flush()
            self._lines.task_done()
