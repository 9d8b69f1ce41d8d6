"""`physment-eval film`: makes films of stored episodes for the report."""

import argparse
import functools
import sys
from collections.abc import Sequence
from contextlib import AbstractAsyncContextManager
from pathlib import Path

from mcp import Client
from rich.console import Console
from rich.progress import Progress

from evaluator.certify.viewed_episode import viewed_episode, viewing
from evaluator.commands.base import Commands, run_async, seed_key
from evaluator.errors import UsageError
from evaluator.films import Opens, film_of
from evaluator.records.episode import Episode, EpisodeKey, Outcome
from evaluator.report.attachments import FILMS, film_file, own_folder, regular_file
from evaluator.report.film_record import MOST_BYTES, read, written
from evaluator.store import durable
from evaluator.store.run_folder import RunFolder
from evaluator.study.forking import CONDITIONS, line_hashes, meeting
from evaluator.study.integrity import seeds_of
from evaluator.study.provenance import refuse_other_worlds

_DESCRIPTION = f"""\
Make films of stored episodes for the report: each is played again in this process, and what its agent could see is kept
in a small file. If the laboratory returns anything but what is stored, to the last bit, that film is refused.

  physment-eval film runs/mine                              every episode that has no film yet
  physment-eval film runs/mine --episodes scene=7,seed=3    some of them
  physment-eval film runs/mine --reveal                     for authors: with all that is hidden, from the start
  physment-eval report runs/mine                            then shows them in its notebooks

--episodes takes conditions, separated by commas: {", ".join(CONDITIONS)}. The films are in DIR/{FILMS}; keep that
folder beside the report. A film made with --reveal shows what agents must not see, and says so. Exit code: 1 if a film
was refused.
"""


def add(commands: Commands) -> None:
    """Declare `film`."""
    command = commands.add_parser(
        "film",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(run=_film)
    command.add_argument("folder", type=Path, metavar="DIR", help="run folder")
    command.add_argument("--episodes", default="", metavar="NAME=VALUE,…", help="which episodes (default: all)")
    command.add_argument(
        "--reveal", action="store_true", help="show all bodies, also those that are hidden or withheld"
    )
    command.add_argument("--scenes-dir", type=Path, metavar="DIR", help="folder of scene packs (default: the suite)")
    seed_key(command)


def _film(args: argparse.Namespace) -> int:
    folder = RunFolder(args.folder)
    if not folder.episodes_file.exists():
        raise UsageError(f"{args.folder} holds no episodes to film")
    episodes = [one for one in folder.episodes().values() if one.outcome is not Outcome.INFRASTRUCTURE_ERROR]
    if folder.run_file.exists():
        refuse_other_worlds(folder.read_run(), args.scenes_dir)
    if args.episodes:
        episodes = meeting(episodes, args.episodes, "--episodes", folder)
    seed_of, find_visibility = seeds_of(folder, args.seed_key), viewing(args.scenes_dir, reveal=args.reveal)

    def opens(key: EpisodeKey) -> AbstractAsyncContextManager[Client]:
        return viewed_episode(key.scene, seed_of(key.scene, key.seed), args.scenes_dir, find_visibility)

    refused = run_async(functools.partial(_make, folder, episodes, opens, revealed=args.reveal))
    for sentence in refused:
        print(f"physment-eval: {sentence}", file=sys.stderr)
    print(
        f"{len(episodes) - len(refused)} films in {folder.path / FILMS}; physment-eval report {args.folder} shows them"
    )
    return 1 if refused else 0


async def _make(folder: RunFolder, episodes: Sequence[Episode], opens: Opens, *, revealed: bool) -> list[str]:
    """Make the missing films; returns an error message for each episode that cannot be filmed."""
    hashes, refused = line_hashes(folder), list[str]()
    own_folder(folder.path / FILMS)
    with Progress(console=Console(stderr=True), transient=True) as progress:
        for episode in progress.track(episodes, description="films"):
            file = film_file(folder.path, hashes[episode.key])
            if _is_made(file, hashes[episode.key], revealed=revealed):
                continue
            try:
                film = await film_of(episode, opens, hashes[episode.key], revealed=revealed)
            except UsageError as error:
                refused.append(str(error))
                continue
            durable.replace(file, written(film))
    return refused


def _is_made(file: Path, record_sha256: str, *, revealed: bool) -> bool:
    """Whether a valid film of this record exists with the same `revealed` setting."""
    try:
        return read(regular_file(file, MOST_BYTES), record_sha256).revealed == revealed
    except (OSError, ValueError):
        return False
