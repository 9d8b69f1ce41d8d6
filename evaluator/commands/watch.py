"""`physment-eval watch`: shows a run in the browser while it is played."""

import argparse
import functools
import socket
from pathlib import Path

import anyio.lowlevel
import uvicorn

from evaluator.answers.keys import KeyRing
from evaluator.commands.base import Commands, listening, open_page, page_token, port, run_async, seed_key
from evaluator.records.run import seed_as_recorded
from evaluator.store.run_folder import RunFolder
from evaluator.study.integrity import is_withheld, seeds_of
from evaluator.watch.app import app
from evaluator.watch.followed_run import FollowedRun

_ADDRESS = "127.0.0.1"
_DESCRIPTION = """\
Show a run in the browser while it is played: which episodes are played now, the accuracy so far with its interval and
its course, cost, the newest episodes with their notebooks, and which are in trouble or were overtaken by later ones. A
run that does not exist yet is waited for. A finished run can be looked at, too, with its report.

  physment-eval watch runs/mine                opens the page, and prints its address
  physment-eval watch runs/mine --no-open      only prints it
  physment-eval watch runs/mine --port 8950    on this port; by default on any free one

The command only reads the run folder, and grades for itself what it shows. The page is for this machine alone, its
address holds a token. To look at a run on another machine, forward the port (ssh -L 8950:127.0.0.1:8950 …). Ctrl-C ends
it; the run goes on.
"""


def add(commands: Commands) -> None:
    """Declare the command `watch` and its options."""
    command = commands.add_parser(
        "watch",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(run=_watch)
    command.add_argument("folder", type=Path, metavar="DIR", help="run folder")
    command.add_argument("--port", type=port, default=0, help="port (default: any free one)")
    command.add_argument("--no-open", action="store_true", help="print the address, and open no browser")
    command.add_argument("--scenes-dir", type=Path, metavar="DIR", help="folder of scene packs (default: the suite)")
    seed_key(command)


def _watch(args: argparse.Namespace) -> int:
    folder = RunFolder(args.folder)
    follow = functools.partial(_follow, folder, args.scenes_dir, args.seed_key)
    begun = follow() is not None
    token = page_token()
    with listening(_ADDRESS, args.port) as listener:
        address = f"http://{_ADDRESS}:{listener.getsockname()[1]}/{token}/"
        waits = "" if begun else "; no run has begun there yet"
        print(f"{args.folder} is shown at {address} until Ctrl-C{waits}", flush=True)
        if not args.no_open:
            open_page(address)
        config = uvicorn.Config(
            app(folder, follow, token),
            log_config=None,
            log_level="warning",
            timeout_graceful_shutdown=1,
            lifespan="off",
        )
        try:
            run_async(functools.partial(_serve, uvicorn.Server(config), listener))
        except KeyboardInterrupt:
            return 0  # Ctrl-C is the normal way to stop
    return 0


def _follow(folder: RunFolder, scenes_dir: Path | None, seed_key: Path | None) -> FollowedRun | None:
    """Open the run that `watch` follows; None if its folder does not exist yet, or is still empty.

    Raises:
        StoreError: The folder holds something else.
        UsageError: The key of the seeds cannot be read.
    """
    path = folder.path
    if not folder.run_file.exists() and (not path.exists() or _is_new(path)):
        return None
    withheld = is_withheld(folder) and seed_key is None
    seed_of = seed_as_recorded if withheld else seeds_of(folder, seed_key)
    return FollowedRun(folder, KeyRing(scenes_dir, seed_of), withheld=withheld)


def _is_new(path: Path) -> bool:
    """Whether a folder holds nothing but hidden files, such as the lock of a run that begins."""
    return path.is_dir() and all(found.name.startswith(".") for found in path.iterdir())


async def _serve(server: uvicorn.Server, listener: socket.socket) -> None:
    await server.serve(sockets=[listener])
    await anyio.lowlevel.checkpoint()  # raises the cancellation by the signal that ended the server
