"""`physment-mcp serve`: many episodes over HTTP, and who may reach them."""

import argparse
import contextlib
import os
import re
import signal
import socket
from importlib.util import find_spec
from threading import Thread

import anyio

from physment_mcp.commands.base import Commands, common_options, observations, port, positive, timestep
from physment_mcp.contract.addresses import is_loopback
from physment_mcp.contract.command_line import restore_sigint
from physment_mcp.errors import NotOpened, UsageError

_OPEN_FILES = 65_536
"""Limit of open files to request from the system."""
_LONGEST_TOKEN = 4096
"""Longest accepted token [bytes]."""
_NAME = re.compile(r"[A-Za-z0-9]{1,32}")
"""Pattern of the values that `--id-prefix` accepts."""


def add(commands: Commands) -> None:
    """Declare `serve`."""
    serve = commands.add_parser(
        "serve",
        parents=[common_options(again=True)],
        help="host many episodes over HTTP",
        description='Host many episodes over HTTP. POST /episodes {"scene": 7, "seed": 0} opens one and returns its'
        " mcp_url; DELETE /episodes/ID closes it; GET /healthz reports how many are open.",
    )
    serve.add_argument(
        "--host", default="127.0.0.1", help="address to listen on (default 127.0.0.1; others need --token-env)"
    )
    serve.add_argument(
        "--port", type=port, default=8000, help="port (default 8000; 0: any free one, printed at the start)"
    )
    serve.add_argument(
        "--max-episodes",
        type=positive(int),
        metavar="N",
        help="most open episodes (default: as many as half of the free memory holds, at 1 MB each; at most 8000)",
    )
    serve.add_argument(
        "--idle-timeout",
        type=positive(float),
        default=1800.0,
        metavar="S",
        help="close an episode unused for S s (1800)",
    )
    serve.add_argument(
        "--token-env",
        metavar="NAME",
        help="environment variable with a token; only requests with this token open episodes (default: all do)",
    )
    serve.add_argument(
        "--token-stdin",
        action="store_true",
        help="the same, with a token that is the first line of stdin, where no other program can read it",
    )
    serve.add_argument(
        "--allow-host",
        action="append",
        default=[],
        metavar="NAME",
        help="name that the host answers to besides its addresses, as behind a proxy; may be given again",
    )
    serve.add_argument(
        "--open",
        metavar="JSON",
        help='open an episode at the start, such as \'{"scene": 7, "max_calls": 60}\', at /episodes/0/mcp, for a client'
        " whose configuration holds a fixed address; with max_calls it can be played without the token of the host",
    )
    _processes(serve)
    observations(serve, again=True)
    timestep(serve, again=True)
    serve.set_defaults(run=run)


def _processes(serve: argparse.ArgumentParser) -> None:
    """Declare the options for a proxy in front of this host, and for the program that starts it."""
    serve.add_argument(
        "--id-prefix",
        type=_id_prefix,
        metavar="NAME",
        help="begin the id of every episode with NAME and a dot, so that a proxy in front of several hosts finds the"
        " one that has it",
    )
    serve.add_argument(
        "--end-with-stdin",
        action="store_true",
        help="end when stdin does: for a program that starts a host and must leave none behind, however it dies",
    )
    serve.add_argument(
        "--control-fd",
        type=int,
        metavar="FD",
        help="descriptor of an inherited Unix socket, through which the program that starts this host also opens"
        " episodes, each on a socket of its own, without HTTP and without a token",
    )


def run(args: argparse.Namespace) -> int:
    """Serve until interrupted.

    Raises:
        UsageError: The address or the token cannot be used.
        SceneError: There are no scenes.
    """
    # --help need not wait for the engine.
    from physment_mcp.scene import scene_ids  # noqa: PLC0415
    from physment_mcp.serving.admission import free_memory, usual_episodes  # noqa: PLC0415
    from physment_mcp.serving.episode_server import EpisodeServer  # noqa: PLC0415
    from physment_mcp.serving.listening import serve  # noqa: PLC0415
    from physment_mcp.serving.views import watching  # noqa: PLC0415

    restore_sigint()
    exposed = not is_loopback(args.host)
    if exposed and args.token_env is None and not args.token_stdin:
        raise UsageError(
            f"--host {args.host} can be reached from other machines, and only loopback (127.0.0.1, ::1) is served"
            " without a token: put a secret into an environment variable and name it with --token-env"
        )
    token, control = _token(args), _control(args)
    scene_ids(args.scenes_dir)
    if args.open is not None:
        _check_opened(args)
    names = (socket.gethostname(), *args.allow_host) if exposed else tuple(args.allow_host)
    if args.end_with_stdin:
        Thread(target=_end_with_stdin, daemon=True).start()
    args.max_episodes = args.max_episodes or usual_episodes(free_memory())
    host = EpisodeServer(
        args.scenes_dir,
        args.max_episodes,
        args.idle_timeout,
        token,
        exposed,
        names,
        watching(args.observations, args.scenes_dir),
        args.timestep,
        control=control,
        opened_at_start=None if args.open is None else args.open.encode(),
        id_prefix=args.id_prefix or "",
    )
    _allow_open_files()
    try:
        serve(host, args.host, args.port)
    except OSError as error:
        raise UsageError(f"cannot listen on {args.host} port {args.port}: {error.strerror}") from error
    return 0


def _check_opened(args: argparse.Namespace) -> None:
    """Check that the episode of `--open` can be opened; its scene stays in the cache.

    Raises:
        UsageError: It cannot be opened.
    """
    from physment_mcp.serving.admission import Admission, EpisodeQuota  # noqa: PLC0415 - as above

    try:
        admission = Admission(args.scenes_dir, EpisodeQuota(1), args.timestep, for_operator=True)
        anyio.run(admission.open, args.open.encode())
    except NotOpened as refusal:
        raise UsageError(f"--open {args.open}: {refusal}") from refusal


def _id_prefix(text: str) -> str:
    """Return the name of a server as a prefix of its episode ids, including the trailing dot.

    Raises:
        ArgumentTypeError: The name has other characters than letters and digits, or more than 32.
    """
    if not _NAME.fullmatch(text):
        raise argparse.ArgumentTypeError(f"{text}: write at most 32 letters and digits")
    return f"{text}."


def _token(args: argparse.Namespace) -> str | None:
    """Return the token of the host; None if it needs none.

    Raises:
        UsageError: The named variable or stdin contains no token, or both options are given.
    """
    if args.token_stdin and args.token_env is not None:
        raise UsageError("--token-env and --token-stdin: give the token in one place")
    if args.token_stdin:
        token = _first_line()
        if not token:
            raise UsageError("--token-stdin: the first line of stdin holds no token")
        return token
    if args.token_env is None:
        return None
    token = os.environ.get(args.token_env, "").strip()
    if not token:
        raise UsageError(f"--token-env {args.token_env}: this variable holds no token")
    return token


def _control(args: argparse.Namespace) -> socket.socket | None:
    """The inherited control socket; None if there is none.

    Raises:
        UsageError: The descriptor is not that of a Unix socket.
    """
    if args.control_fd is None:
        return None
    problem = UsageError(f"--control-fd {args.control_fd}: is not the descriptor of an open Unix socket")
    try:
        control = socket.socket(fileno=args.control_fd)
    except (OSError, OverflowError, ValueError):
        raise problem from None
    if not hasattr(socket, "recv_fds") or control.family is not socket.AF_UNIX:
        control.detach()
        raise problem
    return control


def _first_line() -> str:
    """Read the first line of stdin byte by byte, because `--end-with-stdin` reads the bytes after it."""
    line = b""
    while (byte := os.read(0, 1)) not in {b"", b"\n"} and len(line) < _LONGEST_TOKEN:
        line += byte
    return line.decode("utf-8", "replace").strip()


def _allow_open_files() -> None:
    """Raise the limit of open files as far as the system allows; many systems start with 1024 or fewer."""
    if find_spec("resource") is None:
        return  # Windows has no limit of this kind
    import resource  # noqa: PLC0415

    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = _OPEN_FILES if hard == resource.RLIM_INFINITY else min(hard, _OPEN_FILES)
    if soft != resource.RLIM_INFINITY and soft < most:
        with contextlib.suppress(OSError, ValueError):  # macOS may allow less than it says
            resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))


def _end_with_stdin() -> None:
    """Wait for the end of stdin, then send SIGTERM to this process."""
    while os.read(0, 4096):
        pass
    os.kill(os.getpid(), signal.SIGTERM)
