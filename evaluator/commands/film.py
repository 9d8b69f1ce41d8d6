"""`physment-eval film`: makes films and animated images of stored episodes."""

import argparse
import functools
import os
import sys
from collections.abc import Callable, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractAsyncContextManager
from pathlib import Path
from typing import NamedTuple

from mcp import Client

from evaluator.certify.processes import NoRenderer, in_processes, renderers
from evaluator.certify.viewed_episode import viewed_episode, viewing
from evaluator.commands.base import Commands, count_of, progress_bar, run_async, seed_key
from evaluator.errors import UsageError
from evaluator.films.filming import film_of
from evaluator.records.episode import Episode, EpisodeKey, Outcome
from evaluator.report.attachments import FILMS, film_file, own_folder, regular_file
from evaluator.report.film_record import MOST_BYTES, read, written
from evaluator.store import durable
from evaluator.store.run_folder import RunFolder
from evaluator.study.forking import CONDITIONS, described, meeting
from evaluator.study.integrity import refuse_other_worlds, seeds_of
from scenes import find_pack, read_public, reference_of

WEBP = "webp"
"""Name of the folder of animated images in a run folder."""
MOST_WEBP_BYTES = 4_000_000
"""Largest size of an animated image [bytes]."""
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

    with progress_bar() as progress:
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


class _Image(NamedTuple):
    content: bytes
    frames: int
    duration_s: float


def write_animations(folder: RunFolder, episodes: Sequence[Episode], scenes_dir: Path | None, workers: int) -> int:
    """Write an animated image of each film, and print a line about it.

    If a film gets no image, the reason is printed on stderr.

    Args:
        folder: The run.
        episodes: Episodes whose films have been made.
        scenes_dir: Folder of their packs; the suite's own if None.
        workers: Largest number of processes.

    Returns:
        Number of films without an image, because they are damaged or their image would be too large.

    Raises:
        UsageError: Nothing renders on this machine, or the graphics library crashed.
    """
    hashes, target, refused = folder.line_hashes(), own_folder(folder.path / WEBP), 0
    records = [hashes[one.key] for one in episodes]
    try:
        with (
            renderers(max(1, min(workers, len(episodes)))) as pool,
            progress_bar() as progress,
        ):
            task = progress.add_task("animated images", total=len(episodes))
            images = pool.map(functools.partial(_drawn, folder.path, scenes_dir), episodes, records)
            for episode, record, image in zip(episodes, records, images, strict=True):
                if isinstance(image, str):
                    refused += 1
                    print(f"physment-eval: {image}", file=sys.stderr)
                else:
                    file = target / _name(episode.key, record)
                    durable.replace(file, image.content)
                    size = f"{image.frames} frames, {image.duration_s:.0f} s, {len(image.content) / 1000:.0f} kB"
                    print(f"{file}: {size}", flush=True)
                progress.advance(task)
    except NoRenderer as error:
        raise UsageError(str(error)) from error
    except BrokenProcessPool as error:
        raise UsageError("the graphics library crashed or was ended while it drew an animated image") from error
    return refused


def _name(key: EpisodeKey, record_sha256: str) -> str:
    return f"scene{reference_of(key.scene).replace(':', '-')}-seed{key.seed}-{record_sha256[:8]}.webp"


def _drawn(folder: Path, scenes_dir: Path | None, episode: Episode, record_sha256: str) -> _Image | str:
    """Render the animated image of a film; returns the image, or an error message. Runs in a process of `renderers`."""
    # Imported here, because the graphics library must be chosen first.
    from evaluator.certify.moving_pictures import moving_plate  # noqa: PLC0415 - as above
    from evaluator.films.animation import animation_of  # noqa: PLC0415 - as above

    key = episode.key
    try:
        film = read(regular_file(film_file(folder, record_sha256), MOST_BYTES), record_sha256)
        marked = ", with all that is hidden" if film.revealed else ""
        name = read_public(find_pack(key.scene, scenes_dir)).name
        title = f"{reference_of(key.scene)} {name}, seed {key.seed}, {key.agent}{marked}"
        things, moments = animation_of(film, episode, title)
        content = moving_plate(things, moments, MOST_WEBP_BYTES)
    except (OSError, ValueError) as error:
        return f"{described(key)} gives no animated image: {' '.join(str(error).split())}"
    return _Image(content, len(moments), sum(moment.duration_ms for moment in moments) / 1000)
