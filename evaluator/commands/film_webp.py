"""The animated images of `film --webp`."""

import functools
import sys
from collections.abc import Sequence
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import NamedTuple

from rich.console import Console
from rich.progress import Progress

from evaluator.certify.renderer import NoRenderer, renderers
from evaluator.errors import UsageError
from evaluator.records.episode import Episode, EpisodeKey
from evaluator.report.attachments import film_file, own_folder, regular_file
from evaluator.report.film_record import MOST_BYTES, read
from evaluator.store import durable
from evaluator.store.run_folder import RunFolder
from evaluator.study.forking import described
from scenes import find_pack, reference_of
from scenes.public import read_public

WEBP = "webp"
"""Name of the folder of animated images in a run folder."""
MOST_WEBP_BYTES = 4_000_000
"""Largest size of an animated image [bytes]."""


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
            Progress(console=Console(stderr=True), transient=True) as progress,
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
