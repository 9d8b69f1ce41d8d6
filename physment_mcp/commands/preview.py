"""`physment-mcp preview`: shows the app of the laboratory in a local page, as a chat client does."""

import argparse
import functools
import os
import secrets
import socket
import sys
import webbrowser

import anyio

from physment_mcp.commands.base import Commands, common_options, port, scene_id, timestep, whole_number
from physment_mcp.errors import UsageError

_DESCRIPTION = """\
Show the app of the laboratory in a local page, as a chat client shows it: a frame with the scene, and a form that calls
tools as the model would.

  physment-mcp preview 7
  physment-mcp preview 21 --seed 3 --no-open

The page is for this machine alone, and its address holds a token. Ctrl-C ends it. Nothing is recorded; to solve a scene
and have it graded, use physment-eval play.
"""


def add(commands: Commands) -> None:
    """Declare `preview`."""
    preview = commands.add_parser(
        "preview",
        parents=[common_options(again=True)],
        help="show the app of the chat in a local page",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    preview.add_argument("scene", type=scene_id, metavar="N", help="scene to open, or world:5:17")
    preview.add_argument("--seed", type=whole_number, default=0, metavar="S", help="variant of the scene (default 0)")
    preview.add_argument("--port", type=port, default=0, help="port (default: any free one)")
    preview.add_argument("--no-open", action="store_true", help="print the address, and open no browser")
    timestep(preview, again=True)
    preview.set_defaults(run=_preview)


def _preview(args: argparse.Namespace) -> int:
    import uvicorn  # noqa: PLC0415 - --help need not wait for the engine

    from physment_mcp.commands.preview_app import preview_app  # noqa: PLC0415
    from physment_mcp.scene import load_scene  # noqa: PLC0415
    from physment_mcp.serving.server import build_server  # noqa: PLC0415
    from physment_mcp.serving.slot import EpisodeSlot  # noqa: PLC0415
    from physment_mcp.session import Session  # noqa: PLC0415
    from physment_mcp.visibility import cached_visibility  # noqa: PLC0415

    session = Session(load_scene(args.scene, args.seed, args.scenes_dir, args.timestep))
    server = build_server(EpisodeSlot(session, find_visibility=cached_visibility(args.scenes_dir)))
    token = secrets.token_urlsafe(16)
    try:
        listener = socket.create_server(("127.0.0.1", args.port))
    except OSError as error:
        raise UsageError(f"cannot listen on 127.0.0.1 port {args.port}: {error.strerror}") from error
    with listener:
        address = f"http://127.0.0.1:{listener.getsockname()[1]}/{token}/"
        print(f"the app is shown at {address} until Ctrl-C", flush=True)
        if not args.no_open and _has_display():
            webbrowser.open(address)
        app = preview_app(server, token, session.scene.public.name)
        config = uvicorn.Config(app, log_config=None, log_level="warning", timeout_graceful_shutdown=1)
        anyio.run(functools.partial(uvicorn.Server(config).serve, sockets=[listener]))
    return 0


def _has_display() -> bool:
    """Whether a graphical browser is available. Text browsers are not used, because they would occupy the terminal."""
    return sys.platform in {"win32", "darwin"} or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))
