"""`physment-eval film`: makes films of stored episodes for the report."""

import argparse
import functools
import os
import sys
from collections.abc import Callable, Sequence
from contextlib import AbstractAsyncContextManager
from pathlib import Path

from mcp import Client
from rich.console import Console
from rich.progress import Progress

from evaluator.certify.parallel import in_processes
from evaluator.certify.viewed_episode import viewed_episode, viewing
from evaluator.commands.base import Commands, count_of, run_async, seed_key
from evaluator.commands.film_webp import WEBP, write_animations
from evaluator.errors import UsageError
from evaluator.films.filming import film_of
from evaluator.records.episode import Episode, EpisodeKey, Outcome
from evaluator.report.attachments import FILMS, film_file, own_folder, regular_file
from evaluator.report.film_record import MOST_BYTES, read, written
from evaluator.store import durable
from evaluator.store.run_folder import RunFolder
from evaluator.study.forking import CONDITIONS, meeting
from evaluator.study.integrity import seeds_of
from evaluator.study.run_start import refuse_other_worlds

_FILMS_EACH = 8
"""Smallest number of films per worker process, because starting a process takes about a second."""

_DESCRIPTION = f"""\
Make films of stored episodes for the report: each is played again, and what its agent could see is kept
in a small file. If the laboratory returns anything but what is stored, to the last bit, that film is refused.

  physment-eval film runs/mine                              every episode that has no film yet
  physment-eval film runs/mine --episodes scene=7,seed=3    some of them
  physment-eval film runs/mine --episode 28 --webp          also as an animated image, of scene 28
  physment-eval film runs/mine --reveal                     for authors: with all that is hidden, from the start
  physment-eval report runs/mine                            then shows them in its notebooks

--episodes takes the number of a scene, or conditions, separated by commas: {", ".join(CONDITIONS)}. The films
are in DIR/{FILMS}; keep that folder beside the report. Animated images are in DIR/{WEBP} and need libosmesa6.
A film made with --reveal shows what agents must not see, and says so. Exit code: 1 if a film or an
image was refused.
"""


def add(commands: Commands) -> None:
    """Declare the command `film` and its options."""
    command = commands.add_parser(
        "film",
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    command.set_defaults(run=_film)
    command.add_argument("folder", type=Path, metavar="DIR", help="run folder")
    command.add_argument("--episodes", default="", metavar="NAME=VALUE,…", help="which episodes (default: all)")
    command.add_argument(
        "--webp", action="store_true", help="also write each film as an animated WebP image, with the calls below it"
    )
    command.add_argument(
        "--reveal", action="store_true", help="show all bodies, also those that are hidden or withheld"
    )
    command.add_argument(
        "--workers",
        type=count_of("processes"),
        default=os.cpu_count() or 1,
        metavar="N",
        help="processes (default: one per core, for many films)",
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
    refused = _make(folder, episodes, args)
    for sentence in refused.values():
        print(f"physment-eval: {sentence}", file=sys.stderr)
    print(
        f"{len(episodes) - len(refused)} films in {folder.path / FILMS}; physment-eval report {args.folder} shows them"
    )
    without_image = 0
    if args.webp:
        filmed = [one for one in episodes if one.key not in refused]
        without_image = write_animations(folder, filmed, args.scenes_dir, args.workers)
    return 1 if refused or without_image else 0


def _make(folder: RunFolder, episodes: Sequence[Episode], args: argparse.Namespace) -> dict[EpisodeKey, str]:
    """Make the missing films; returns an error message for each episode that cannot be filmed."""
    hashes, seed_of, refused = folder.line_hashes(), seeds_of(folder, args.seed_key), dict[EpisodeKey, str]()
    own_folder(folder.path / FILMS)
    files = {episode.key: film_file(folder.path, hashes[episode.key]) for episode in episodes}
    missing = [one for one in episodes if not _is_made(files[one.key], hashes[one.key], revealed=args.reveal)]
    # Workers cache what may be seen in a scene, so the episodes of a scene follow each other.
    missing.sort(key=lambda episode: episode.key.scene)

    def work(episode: Episode) -> Callable[[], bytes | str]:
        seed = seed_of(episode.key.scene, episode.key.seed)
        return functools.partial(_filmed, episode, seed, hashes[episode.key], args.scenes_dir, revealed=args.reveal)

    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("films", total=len(missing))

        def on_done(episode: Episode, made: bytes | str) -> None:
            if isinstance(made, str):
                refused[episode.key] = made
            else:
                durable.replace(files[episode.key], made)
            progress.advance(task)

        workers = min(args.workers, max(1, len(missing) // _FILMS_EACH))
        if workers > 1:
            run_async(functools.partial(in_processes, missing, work, workers, on_done))
        else:
            for episode in missing:
                on_done(episode, work(episode)())
    return refused


def _filmed(episode: Episode, seed: int, record_sha256: str, scenes_dir: Path | None, *, revealed: bool) -> bytes | str:
    """Return the film of an episode as a script, or an error message; may run in a worker process."""
    find_visibility = viewing(scenes_dir, reveal=revealed)

    def opens(key: EpisodeKey) -> AbstractAsyncContextManager[Client]:
        return viewed_episode(key.scene, seed, scenes_dir, find_visibility)

    try:
        return written(run_async(functools.partial(film_of, episode, opens, record_sha256, revealed=revealed)))
    except UsageError as error:
        return str(error)


def _is_made(file: Path, record_sha256: str, *, revealed: bool) -> bool:
    """Whether a valid film of this record exists with the same `revealed` setting."""
    try:
        return read(regular_file(file, MOST_BYTES), record_sha256).revealed == revealed
    except (OSError, ValueError):
        return False
