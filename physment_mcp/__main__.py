"""Command line of the laboratory: one episode on stdio, or a host of many over HTTP. The only reader of argv."""

import argparse
import logging
import math
import os
import socket
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import anyio

from physment_mcp import __version__
from physment_mcp.errors import SceneError

_DESCRIPTION = """\
A physics laboratory over MCP: one MuJoCo scene per episode, 26 typed tools.

Without a command it serves one episode on stdin and stdout, for an MCP client that starts it:
  physment-mcp --scene 7             scene 7, as written
  physment-mcp --scene 7 --seed 3    a variant of it, with other hidden values
  physment-mcp                       starts idle; the MCP prompt `scene` opens a scene

`physment-mcp serve` keeps many episodes warm in one process, over HTTP on this machine.
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code: 0 done, 2 usage or a scene that cannot be loaded."""
    args = _parser().parse_args(argv)
    logging.basicConfig(stream=sys.stderr, level=args.log_level.upper(), format="%(levelname)s %(name)s: %(message)s")
    try:
        if args.command == "serve":
            return _serve(args)
        return _stdio(args)
    except SceneError as error:
        print(f"physment-mcp: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


def _parser() -> argparse.ArgumentParser:
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument(
        "--scenes-dir",
        type=Path,
        metavar="DIR",
        help="folder of scene packs (Scene7/scene7.json, …); default: the suite",
    )
    common.add_argument(
        "--log-level", choices=["debug", "info", "warning", "error"], default="warning", help="to stderr"
    )
    parser = argparse.ArgumentParser(
        "physment-mcp",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        parents=[common],
    )
    parser.add_argument("--version", action="version", version=f"physment-mcp {__version__}")
    parser.add_argument("--scene", type=int, metavar="N", help="scene to open; default: start idle")
    parser.add_argument("--seed", type=int, default=0, metavar="S", help="variant of the scene (default 0: as written)")
    commands = parser.add_subparsers(dest="command", metavar="serve")
    serve = commands.add_parser(
        "serve",
        parents=[common],
        help="host many episodes over HTTP",
        description='Host many episodes over HTTP. POST /episodes {"scene": 7, "seed": 0} opens one and returns its'
        " mcp_url; DELETE /episodes/ID closes it; GET /healthz tells how many are open.",
    )
    serve.add_argument(
        "--host", default="127.0.0.1", help="address to listen on (default 127.0.0.1; others need --token-env)"
    )
    serve.add_argument(
        "--port", type=_port, default=8000, help="port (default 8000; 0: any free one, printed at the start)"
    )
    serve.add_argument(
        "--max-episodes", type=_positive(int), default=1000, metavar="N", help="most open episodes (1000)"
    )
    serve.add_argument(
        "--idle-timeout",
        type=_positive(float),
        default=1800.0,
        metavar="S",
        help="close an episode unused for S s (1800)",
    )
    serve.add_argument(
        "--token-env",
        metavar="NAME",
        help="environment variable with a token; only requests that bear it open episodes (default: all do)",
    )
    serve.add_argument(
        "--allow-host",
        action="append",
        default=[],
        metavar="NAME",
        help="name that the host answers to besides its addresses, as behind a proxy; may be given again",
    )
    return parser


def _port(text: str) -> int:
    if not text.isdecimal() or int(text) > 65535:
        raise argparse.ArgumentTypeError(f"{text} is not a port; ports are 0 to 65535")
    return int(text)


def _positive(kind: type[int] | type[float]) -> "partial[int | float]":
    def parse(kind: type[int] | type[float], text: str) -> int | float:
        value = kind(text)
        if not (value > 0 and math.isfinite(value)):
            raise argparse.ArgumentTypeError(f"{text} is not above 0")
        return value

    return partial(parse, kind)


def _stdio(args: argparse.Namespace) -> int:
    from physment_mcp.laboratory import Laboratory  # noqa: PLC0415 - --help need not wait for the engine
    from physment_mcp.scene import list_cards, load_scene, scene_ids  # noqa: PLC0415
    from physment_mcp.server import build_server  # noqa: PLC0415
    from physment_mcp.session import Session  # noqa: PLC0415

    def reopen(scene_id: int) -> Session:
        return Session(load_scene(scene_id, args.seed, args.scenes_dir))

    if args.scene is None:
        ids = scene_ids(args.scenes_dir)
        laboratory = Laboratory(reopen=reopen, scene_ids=ids, list_scenes=partial(list_cards, args.scenes_dir))
    else:
        laboratory = Laboratory(reopen(args.scene))
    server = build_server(laboratory)

    async def run() -> None:
        from mcp.server.stdio import stdio_server  # noqa: PLC0415

        async with stdio_server() as (read, write):
            await server.run(read, write, server.create_initialization_options())

    anyio.run(run)
    return 0


def _serve(args: argparse.Namespace) -> int:
    from physment_mcp.gate import is_loopback  # noqa: PLC0415
    from physment_mcp.host import Host, serve  # noqa: PLC0415
    from physment_mcp.scene import scene_ids  # noqa: PLC0415

    exposed = not is_loopback(args.host)
    if exposed and args.token_env is None:
        print(
            f"physment-mcp: --host {args.host} can be reached from other machines, and only loopback (127.0.0.1, ::1)"
            " is served without a token: put a secret into an environment variable and name it with --token-env",
            file=sys.stderr,
        )
        return 2
    token = None if args.token_env is None else os.environ.get(args.token_env, "").strip()
    if token == "":
        print(f"physment-mcp: --token-env {args.token_env}: this variable holds no token", file=sys.stderr)
        return 2
    scene_ids(args.scenes_dir)
    names = (socket.gethostname(), *args.allow_host) if exposed else tuple(args.allow_host)
    host = Host(args.scenes_dir, args.max_episodes, args.idle_timeout, token, exposed, names)
    try:
        serve(host, args.host, args.port)
    except OSError as error:
        print(f"physment-mcp: cannot listen on {args.host} port {args.port}: {error.strerror}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
