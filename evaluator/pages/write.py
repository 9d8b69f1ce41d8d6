"""Writes the documentation pages of a folder of packs: plays the reference protocols and renders the pictures."""

import ast
import json
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

from evaluator.certify.difficulty import ReferenceTurn, Transcript, play
from evaluator.certify.processes import NoRenderer
from evaluator.certify.records import read_certificates
from evaluator.errors import UsageError
from evaluator.pages.pictures import Picture, draw_pictures
from evaluator.pages.scene_table import PICTURES, SCENES_PAGE, SMALL, Listing, Steps, page_name, scene_page, scenes_page
from scenes import Pack, PackError, PackFiles, PublicPack, read_pack, same_pack
from scenes.protocol import ANSWER, Call, Reading

EXAMPLES = (7, 16, 21, 26, 41, 46, 51, 66, 71, 76, 91, 96, 101)
"""One scene of each category, in the order of the categories."""
SEED = 1

_CALLS, _FIRST_CALLS = 10, 6
"""If a turn has more than 10 calls, only its first 6 are shown."""
_TURNS, _FIRST_TURNS, _LAST_TURNS = 6, 3, 2
"""If a run has more than 6 turns, only its first 3 and last 2 are shown."""
_NOISE = 1e-9
"""Smaller readings are rounding errors and shown as 0."""

_HEAD = f"""\
# Worked examples

Made from the packs by `make pages`; do not edit.

> **This page discloses the method of these {len(EXAMPLES)} scenes.** A model that has read it has an advantage in them,
> also at other seeds. Keep the page out of training data and prompts, or leave these scenes out of the result.

One scene of each category, played by its reference protocol at seed {SEED}. The task is the same for every seed; the
hidden values depend on the seed and are not shown. The answer is the submitted one, not the key.

An iteration is one reply with any number of calls; the result of a call follows the arrow. Readings are in SI units,
rounded to five digits; `t` is the simulated time. Longer runs are abridged.
"""


@dataclass(frozen=True, slots=True)
class Example:
    """A scene, the transcript of its reference protocol, and the summary of its solution."""

    scene: int
    pack: Pack
    transcript: Transcript
    summary: str
    """Docstring of `solution.py`, without the scene's number."""


def examples_page(examples: Sequence[Example]) -> str:
    """Generate the page, with one section per example."""
    return "\n".join([_HEAD, *map(_section, examples)]).rstrip() + "\n"


def _section(example: Example) -> str:
    pack, transcript = example.pack, example.transcript
    category = pack.category.value if pack.category else "without category"
    calls = sum(len(turn.calls) for turn in transcript.turns)
    left_out = calls - _shown(transcript.turns)
    abridged = f" {left_out} of the calls are left out below." if left_out else ""
    return "\n\n".join(
        (
            f"## {category}: {pack.metadata.scene_name} (scene {example.scene})",
            f"**Task.** {pack.metadata.task}",
            f"**Idea.** {example.summary}",
            f"**Why it works.** {pack.reasoning}",
            f"**What is done.** {pack.expected_behavior}",
            f"**How.** {transcript.method}",
            f"**The run** takes {_count(len(transcript.turns), 'iteration')} and {_count(calls, 'call')}.{abridged}",
            "```text\n" + "\n".join(_lines(transcript.turns)) + "\n```\n",
        )
    )


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"


def _gap(turns: Sequence[ReferenceTurn]) -> range:
    """Return the indices of the turns that the page omits from an example."""
    return range(_FIRST_TURNS, len(turns) - _LAST_TURNS) if len(turns) > _TURNS else range(0)


def _shown(turns: Sequence[ReferenceTurn]) -> int:
    gap = _gap(turns)
    return sum(len(_kept(turn)) for place, turn in enumerate(turns) if place not in gap)


def _kept(turn: ReferenceTurn) -> tuple[Call, ...]:
    return turn.calls if len(turn.calls) <= _CALLS else turn.calls[:_FIRST_CALLS]


def _lines(turns: Sequence[ReferenceTurn]) -> list[str]:
    gap, lines = _gap(turns), list[str]()
    for place, turn in enumerate(turns):
        if place in gap:
            if place == gap[0]:
                missing = sum(len(turns[index].calls) for index in gap)
                lines.append(f"iterations {gap[0] + 1} to {gap[-1] + 1} left out: {_count(missing, 'call')}")
            continue
        lines.append(f"iteration {place + 1}")
        kept = _kept(turn)
        readings = turn.readings[: len(kept)] or (None,) * len(kept)
        lines += [f"  {_call(call)}{_result(call, reading)}" for call, reading in zip(kept, readings, strict=True)]
        if len(kept) < len(turn.calls):
            lines.append(f"  and {_count(len(turn.calls) - len(kept), 'more call')}, left out")
    return lines


def _call(call: Call) -> str:
    return f"{call.tool}({', '.join(f'{name}={_value(value)}' for name, value in call.arguments.items())})"


def _result(call: Call, reading: Reading | None) -> str:
    if reading is None or call.tool == ANSWER:
        return ""
    if call.tool == "step" and "sim_time" in reading:
        return f"  →  t = {_value(reading['sim_time'])}"
    shown = {name: value for name, value in reading.items() if name != "sim_time"}
    if "status" in shown:
        # The other fields in the result of an action repeat its arguments.
        shown = {name: shown[name] for name in ("status", "revealed") if name in shown}
    return f"  →  {_fields(shown)}"


def _fields(values: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} {_value(value)}" for name, value in values.items() if value is not None)


def _value(value: Any) -> str:
    if isinstance(value, float):
        return f"{0.0 if abs(value) < _NOISE else value:.5g}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(part) for part in cast("Sequence[Any]", value)) + "]"
    if isinstance(value, Mapping):
        return "{" + _fields(cast("Mapping[str, Any]", value)) + "}"
    return json.dumps(value, ensure_ascii=False)


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
    packs: Sequence[PackFiles],
    out: Path,
    difficulties: Mapping[int, str],
    *,
    pictures: bool,
    jobs: int,
    on_done: Callable[[str], None],
) -> Written:
    """Write the pages and the pictures. This executes the packs' `solution.py`.

    Args:
        packs: The scenes.
        out: Folder of the documentation.
        difficulties: Scene → sentences about its calibrated difficulty, for scenes that have one.
        pictures: Whether to render pictures.
        jobs: Number of processes that render pictures.
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
    _write(written, {folder / name: text.encode() for name, text in scene_pages(read, listings, shown, difficulties)})
    _write(written, {out / SCENES_PAGE: page.encode(), out / EXAMPLES_PAGE: examples_page(examples).encode()})
    return written


def scene_pages(
    read: Mapping[PackFiles, Pack],
    listings: Sequence[Listing],
    shown: Collection[int],
    difficulties: Mapping[int, str],
) -> Iterator[tuple[str, str]]:
    """Yield the file name and the text of the page of each scene."""
    packs = {files.scene_id: (files, pack) for files, pack in read.items()}
    for listing in listings:
        files, pack = packs[listing.scene]
        stored = read_certificates(files.folder.parent)
        found = [one for one in stored.scenes if one.scene == listing.scene] if stored else []
        yield (
            page_name(listing.scene),
            scene_page(
                listing,
                PublicPack.of(listing.scene, pack),
                pictured=listing.scene in shown,
                certificate=found[0] if found and same_pack(found[0].pack, files) else None,
                engine=stored.engine if stored else "",
                example=listing.scene in EXAMPLES,
                difficulty=difficulties.get(listing.scene, ""),
            ),
        )


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
        written.unpictured = f"{reason}, or leave them out with --no-pictures"
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
