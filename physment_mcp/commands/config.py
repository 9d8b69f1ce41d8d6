"""`physment-mcp config`: prints the entry that starts the laboratory, for the configuration of an MCP client."""

import argparse
import json
import shutil
import sys
import sysconfig
from dataclasses import dataclass
from pathlib import Path

from physment_mcp.commands.base import Commands, common_options, observations, scene_id, whole_number
from physment_mcp.errors import SceneError
from scenes import PackError, find_pack


@dataclass(frozen=True, slots=True)
class _Client:
    """How the configuration file of a client declares a server."""

    key: str
    """Key under which servers are listed."""
    typed: bool
    """Whether an entry names the transport."""
    where: str
    """Location of the file and the next step, shown to the person."""


_CLIENTS = {
    "claude-desktop": _Client(
        "mcpServers",
        typed=False,
        where="Claude Desktop: Settings > Developer > Edit Config opens claude_desktop_config.json. Put this in (if it"
        " lists servers already, put this one beside them), save it, and restart Claude Desktop.",
    ),
    "claude-code": _Client(
        "mcpServers",
        typed=True,
        where="Claude Code: put this into .mcp.json in the folder of your project, start `claude` there, and look with"
        " /mcp.",
    ),
    "vscode": _Client(
        "servers",
        typed=True,
        where="VS Code: put this into .vscode/mcp.json in your workspace, and press Start above it.",
    ),
    "cursor": _Client(
        "mcpServers",
        typed=True,
        where="Cursor: put this into .cursor/mcp.json in your project (or ~/.cursor/mcp.json), and switch it on in"
        " Settings > MCP.",
    ),
}


def add(commands: Commands) -> None:
    """Declare `config`."""
    config = commands.add_parser(
        "config",
        parents=[common_options(again=True)],
        help="print the configuration of an MCP client, to paste",
        description="Print, as JSON on stdout, what to paste into the configuration of an MCP client. Without --scene"
        " the laboratory starts idle and the prompt `scene` opens one.",
    )
    config.add_argument("client", choices=_CLIENTS, help="which client")
    config.add_argument("--scene", type=scene_id, default=argparse.SUPPRESS, metavar="N", help="scene to open")
    config.add_argument(
        "--seed", type=whole_number, default=argparse.SUPPRESS, metavar="S", help="variant of the scene"
    )
    observations(config, again=True)
    config.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the configuration entry on stdout, and the name of the file that it belongs to on stderr.

    Raises:
        SceneError: There is no such scene.
    """
    command, *arguments = own_command()
    try:
        if args.scene is not None:
            find_pack(args.scene, args.scenes_dir)
            arguments += ["--scene", str(args.scene)]
    except PackError as error:
        raise SceneError(str(error)) from error
    arguments += ["--seed", str(args.seed)] if args.seed else []
    arguments += ["--observations", args.observations] if args.observations != "text" else []
    # The client chooses the folder in which it starts the laboratory, so the path must be absolute.
    arguments += ["--scenes-dir", str(args.scenes_dir.absolute())] if args.scenes_dir else []
    client = _CLIENTS[args.client]
    server = {"type": "stdio"} if client.typed else {}
    written = {client.key: {"physment": server | {"command": command, "args": arguments}}}
    print(json.dumps(written, indent=2, ensure_ascii=False))
    print(client.where, file=sys.stderr)
    return 0


def own_command() -> list[str]:
    """The command that starts this installation of the laboratory from any folder."""
    # Not resolved: the interpreter of a virtual environment is a link, and its target does not find our packages.
    program = shutil.which("physment-mcp", path=sysconfig.get_path("scripts"))
    return [str(Path(program).absolute())] if program else [str(Path(sys.executable).absolute()), "-m", "physment_mcp"]
