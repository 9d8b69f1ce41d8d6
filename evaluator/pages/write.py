"""Writes the pages for a folder of packs: plays the reference protocols, draws the pictures, writes the files."""

import ast
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from evaluator.certify.transcript import Transcript, play
from evaluator.errors import UsageError
from evaluator.pages.listing import Listing, Steps
from evaluator.pages.pictures import NoRenderer, Picture, draw_pictures
from evaluator.pages.scene_table import PICTURES, SCENES_PAGE, SMALL, scenes_page
from evaluator.pages.worked_examples import EXAMPLES, SEED, Example, examples_page
from scenes import Pack, PackError, PackFiles, read_pack

EXAMPLES_PAGE = Path("explanation", "worked-examples.md")

_SEEDS = 5
"""Number of seeds, from 0 on, over which the length of a protocol is measured."""


@dataclass(slots=True)
class Written:
    """The result of writing the pages."""

    files: list[Path] = field(default_factory=list[Path])
    faults: list[str] = field(default_factory=list[str])
    """One sentence for each fault of a pack that changes the pages."""
    unpictured: str = ""
    """Why there are no pictures; empty if there are."""


def write_pages(
    packs: Sequence[PackFiles], out: Path, *, pictures: bool, jobs: int, on_done: Callable[[str], None]
) -> Written:
    """Write both pages and the pictures. This executes the packs' `solution.py`.

    Args:
        packs: The scenes.
        out: Folder of the documentation.
        pictures: Whether to draw pictures.
        jobs: Number of processes that draw.
        on_done: Called with a short text when a part is ready.

    Raises:
        UsageError: A file cannot be written.
    """
    written = Written()
    read = _read_all(packs, written)
    listings = [Listing.of(files, pack, _steps(files, written)) for files, pack in sorted(read.items(), key=_by_id)]
    on_done(f"{len(listings)} reference protocols")
    drawn = _drawn(list(read), jobs, written) if pictures else dict[int, Picture]()
    on_done(f"{sum(not picture.fault for picture in drawn.values())} pictures")
    examples = [
        Example(files.scene_id, pack, transcript, _summary(files))
        for files, pack in sorted(read.items(), key=_by_id)
        if files.scene_id in EXAMPLES and (transcript := _played(files, SEED, written))
    ]
    folder = out / SCENES_PAGE.parent / PICTURES
    shown = {scene: picture for scene, picture in drawn.items() if not picture.fault}
    _write(written, {folder / f"scene{scene}.png": picture.png for scene, picture in shown.items()})
    _write(written, {folder / SMALL / f"scene{scene}.png": picture.thumbnail for scene, picture in shown.items()})
    page = scenes_page(listings, shown)
    _write(written, {out / SCENES_PAGE: page.encode(), out / EXAMPLES_PAGE: examples_page(examples).encode()})
    return written


def _by_id(entry: tuple[PackFiles, Pack]) -> int:
    return entry[0].scene_id


def _read_all(packs: Sequence[PackFiles], written: Written) -> dict[PackFiles, Pack]:
    read: dict[PackFiles, Pack] = {}
    for files in packs:
        try:
            read[files] = read_pack(files)
        except PackError as error:
            written.faults.append(f"scene {files.scene_id} is left out: {error}")
    return read


def _played(files: PackFiles, seed: int, written: Written) -> Transcript | None:
    try:
        return play(files, seed)
    except PackError as error:
        written.faults.append(f"scene {files.scene_id} is listed without its run: {error}")
        return None


def _steps(files: PackFiles, written: Written) -> Steps | None:
    runs: list[Transcript] = []
    for seed in range(_SEEDS):
        run = _played(files, seed, written)
        if run is None:
            return None
        runs.append(run)
    iterations, interventions = [len(run.turns) for run in runs], [run.interventions for run in runs]
    return Steps((min(iterations), max(iterations)), (min(interventions), max(interventions)))


def _drawn(packs: Sequence[PackFiles], jobs: int, written: Written) -> Mapping[int, Picture]:
    try:
        pictures = draw_pictures(packs, jobs)
    except NoRenderer as reason:
        written.unpictured = str(reason)
        return dict[int, Picture]()
    written.faults += [
        f"scene {scene} has no picture: {picture.fault}" for scene, picture in pictures.items() if picture.fault
    ]
    return pictures


def _summary(files: PackFiles) -> str:
    docstring = ast.get_docstring(ast.parse(files.solution.read_text(encoding="utf-8"))) or ""
    first = docstring.split("\n\n")[0].removeprefix(f"Scene {files.scene_id}:").strip()
    return first[:1].upper() + first[1:]


def _write(written: Written, contents: Mapping[Path, bytes]) -> None:
    for path, content in contents.items():
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
        except OSError as error:
            raise UsageError(f"{path} cannot be written: {error.strerror}") from error
        written.files.append(path)
