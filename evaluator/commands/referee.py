"""`physment-eval referee`: an HTTP service that opens episodes for a trainer and returns their rewards."""

import argparse
import contextlib
import functools
import json
import os
import socket
import sys
from collections.abc import AsyncGenerator, Iterable
from dataclasses import replace
from pathlib import Path

import anyio.lowlevel
import uvicorn

from evaluator.answers.keys import KeyRing
from evaluator.answers.rewards import RewardRule, Worth
from evaluator.calibration.adaptive import DIFFICULTIES, read_difficulties
from evaluator.certify.seed_proofs import SeedProver
from evaluator.commands.base import (
    Commands,
    count_of,
    folder_to_write,
    listening,
    port,
    price,
    run_async,
    seconds,
    unproved,
)
from evaluator.episode.connect import connect
from evaluator.episode.hosts import HostConnector
from evaluator.errors import InfrastructureError, UsageError
from evaluator.records.run import Plan, SeedKey, seed_as_recorded
from evaluator.referee.episodes import Referee
from evaluator.referee.requests import app
from evaluator.store.redaction import Redaction
from evaluator.store.run_folder import RunFolder
from evaluator.study.integrity import Sealing, read_seed_key
from evaluator.study.run_start import run_record, server_record
from evaluator.study.selection import parse_scenes
from physment_mcp.contract.addresses import is_loopback
from scenes import PackFiles, default_folder
from scenes.splits import HELD_BACK
from scenes.worlds.folders import levels_of, worlds_of

_KEEP_ALIVE_S = 60
"""Keep-alive timeout of idle connections [s]."""
_MORE_CONNECTIONS = 100
"""Allowed connections besides two per episode. Further requests are answered with status 503."""
_DESCRIPTION = """\
Open episodes for a trainer, and say after the end of each what it was worth. The answer keys stay in this process.

  physment-eval referee                              on http://127.0.0.1:8900, with a host of its own
  physment-eval referee --server http://127.0.0.1:8000 --reward graded --cost-per-call 0.01
  physment-eval referee --out runs/training          and keep every graded episode, for grade and report

  POST   /episodes {"scene": 7, "seed": 3}           opens one: mcp_url, player_token, prompt, tools, owner_token
  POST   /episodes {"split": "train", "index": 12}   the same, by place in a split; or {"split": …, "random_seed": 5}
  POST   /episodes {"world": {"level": 5}}           a world that was made before, of a level or with so many "terms"
  POST   /episodes {"split": …, "index": 12, "count": 8}   eight episodes of one variant, for one prompt
  POST   /episodes/ID/reward                         its reward, once, with the owner_token as bearer token
  POST   /episodes/ID/reward {"end": "budget_exhausted"}   the same, for an episode that ends without an answer
  DELETE /episodes/ID                                closes it without a reward
  POST   /checks {"scene": 7, "seed": 3}             the reward of the scene's reference protocol
  GET    /variants?split=train                       rung, category, chance, reference and difficulty of each scene
  GET    /healthz                                    how many episodes are open
  GET    /metrics                                    the same and more, for Prometheus

Only the mcp_url and the player_token are for the agent. docs/how-to/train.md shows the way to a training run.
"""


def add(commands: Commands) -> None:
    """Declare the command `referee` and its options."""
    command = commands.add_parser(
        "referee",
        help="open episodes for a trainer, and give each a reward",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(run=_referee)
    command.add_argument(
        "--server", default="host", metavar="S", help="host (default: a host of its own) · the URL of a host"
    )
    command.add_argument("--scenes-dir", type=Path, metavar="DIR", help="folder of scene packs (default: the suite)")
    command.add_argument(
        "--reward",
        choices=[worth.value for worth in Worth],
        default=Worth.STRICT.value,
        help="strict: 1 if the answer is right, else 0 (default) · graded: the share of right sub-answers ·"
        " chance-corrected: 1 if it is right, else so far below 0 that blind guesses earn 0 on average",
    )
    command.add_argument(
        "--cost-per-iteration", type=price, default=0.0, metavar="X", help="taken off for each iteration (0)"
    )
    command.add_argument("--cost-per-call", type=price, default=0.0, metavar="X", help="taken off for each call (0)")
    _add_service(command)


def _add_service(command: argparse.ArgumentParser) -> None:
    """Declare the options of the service: address, token, scenes, and the files that it writes."""
    command.add_argument(
        "--shaping",
        action="store_true",
        help="add to each reward a list with the shaping reward of every call: by how much it lowers the logarithm of"
        " the answer's error bound (takes seconds; off by default)",
    )
    command.add_argument(
        "--host", default="127.0.0.1", help="address to listen on (default 127.0.0.1; others need --token-env)"
    )
    command.add_argument(
        "--port", type=port, default=8900, help="port (default 8900; 0: any free one, printed at the start)"
    )
    command.add_argument(
        "--token-env",
        metavar="NAME",
        help="environment variable with a token; only requests with this token open episodes (default: all do)",
    )
    command.add_argument(
        "--max-episodes", type=count_of("episodes"), default=1000, metavar="N", help="most open episodes (1000)"
    )
    command.add_argument(
        "--max-wall-time",
        type=seconds,
        default=3600.0,
        metavar="S",
        help="close an episode whose reward was not asked for within S s (3600)",
    )
    command.add_argument(
        "--difficulties",
        type=Path,
        metavar="FILE",
        help="calibration.json of `calibrate --out`, for GET /variants (default: the one that ships)",
    )
    command.add_argument(
        "--seed-key",
        type=Path,
        metavar="FILE",
        help=f"open variants of the split {HELD_BACK} alone: the key in FILE gives the seeds, a seed in a request then"
        " numbers a variant, and neither replies nor records tell the seeds",
    )
    unproved(command)
    command.add_argument(
        "--out", type=folder_to_write, metavar="DIR", help="run folder for the graded episodes (default: none)"
    )
    command.add_argument(
        "--name", default="trainer", metavar="NAME", help="who plays, in the records of --out (default %(default)s)"
    )


def _referee(args: argparse.Namespace) -> int:
    packs = parse_scenes(None, args.scenes_dir)
    token = _token(args)
    seed_key = read_seed_key(args.seed_key) if args.seed_key else None
    with listening(args.host, args.port) as listener:
        run_async(functools.partial(_serve, args, packs, seed_key, token, listener))
    return 0


def _difficulties(file: Path | None, packs: Iterable[PackFiles]) -> dict[int, tuple[float, float]]:
    """Read the difficulty and standard error of each pack in a calibration; by default the shipped one.

    Raises:
        UsageError: The file is not a calibration.
    """
    table = read_difficulties(file or DIFFICULTIES)
    found = {files.scene_id: table.difficulties[files.scene_id] for files in packs if table.holds(files)}
    return {scene: (difficulty.logits, difficulty.se) for scene, difficulty in found.items()}


def _token(args: argparse.Namespace) -> str | None:
    """Read the bearer token of the referee; None if it serves without one.

    Raises:
        UsageError: A token is required and missing, or the environment variable is empty.
    """
    if args.token_env is None:
        if is_loopback(args.host):
            return None
        raise UsageError(
            f"--host {args.host} can be reached from other machines, and only loopback (127.0.0.1, ::1) is served"
            " without a token: put a secret into an environment variable and name it with --token-env"
        )
    token = os.environ.get(args.token_env, "").strip()
    if not token:
        raise UsageError(f"--token-env {args.token_env}: this variable holds no token")
    return token


async def _serve(
    args: argparse.Namespace,
    packs: list[PackFiles],
    seed_key: SeedKey | None,
    token: str | None,
    listener: socket.socket,
) -> None:
    """Serve until interrupted. Prints one line of JSON with the address."""
    seed_of = seed_key.seed if seed_key else seed_as_recorded
    async with connect(args.server, args.scenes_dir, seed_of=seed_of) as host:
        if not isinstance(host, HostConnector):
            raise UsageError(f"--server {args.server}: a referee needs a laboratory with an address: host, or a URL")
        async with _refereeing(args, packs, seed_key, host) as referee:
            bound, chosen = listener.getsockname()[:2]
            shown = f"[{bound}]" if ":" in bound else bound
            print(json.dumps({"listening": f"http://{shown}:{chosen}"}), flush=True)
            config = uvicorn.Config(
                app(referee, token),
                limit_concurrency=2 * args.max_episodes + _MORE_CONNECTIONS,
                log_config=None,
                log_level="warning",
                timeout_graceful_shutdown=2,
                timeout_keep_alive=_KEEP_ALIVE_S,
            )
            await uvicorn.Server(config).serve(sockets=[listener])
            await anyio.lowlevel.checkpoint()  # raises the cancellation by the signal that ended the server


def _any_scene(packs: list[PackFiles], scenes_dir: Path | None) -> int:
    """Return the id of a scene that the host can open."""
    folder = scenes_dir or default_folder()
    worlds = (record.scene_id for level in levels_of(folder) for record in worlds_of(folder, level))
    found = packs[0].scene_id if packs else next(worlds, None)
    if found is None:
        raise UsageError(f"{folder} holds neither scenes nor worlds")
    return found


@contextlib.asynccontextmanager
async def _refereeing(
    args: argparse.Namespace, packs: list[PackFiles], seed_key: SeedKey | None, host: HostConnector
) -> AsyncGenerator[Referee]:
    """Create the referee; on exit, write the record of the run and its seal.

    Raises:
        UsageError: The host cannot be used.
        StoreError: The run folder cannot be used.
    """
    plan = Plan(
        scenes=tuple(files.scene_id for files in packs),
        agents=(args.name,),
        split=HELD_BACK if seed_key else "",
        held_back=seed_key.commitment if seed_key else "",
    )
    try:
        async with host.open(_any_scene(packs, args.scenes_dir), 0) as client:
            server = await server_record(client, args.server)
    except InfrastructureError as error:
        raise UsageError(str(error)) from error
    rule = RewardRule(Worth(args.reward), args.cost_per_iteration, args.cost_per_call)
    referee = Referee(
        host,
        KeyRing(args.scenes_dir, host.seed_of),
        run_record(plan, packs, server),
        rule,
        prover=SeedProver(packs, args.scenes_dir, host.seed_of, plan.held_back, skip=args.unproved),
        shapes=args.shaping,
        max_episodes=args.max_episodes,
        max_wall_s=args.max_wall_time,
        difficulties=_difficulties(args.difficulties, packs),
    )
    if args.out is None:
        yield referee
        return
    folder = RunFolder(args.out, Redaction.of(os.environ, {"host token": host.token} if host.token else {}))
    folder.create(resume=False)
    with folder.held():
        sealing = Sealing(folder)
        folder.write_run(referee.record)
        referee.folder = replace(folder, on_line=sealing.add)
        try:
            yield referee
        finally:
            folder.write_run(referee.played_record())
            folder.write_seal(sealing.seal)
            again = f"physment-eval grade {folder.path}" + (f" --seed-key {args.seed_key}" if seed_key else "")
            print(f"{sealing.sentence()}\nrun folder: {folder.path}   to report: {again}", file=sys.stderr)
