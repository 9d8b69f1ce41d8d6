"""View model of one episode in a report: label, reasoning, table rows of calls, charts."""

import base64
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, cast

from evaluator.records.episode import EpisodeKey, Exchange, Frame
from evaluator.report.agent_results import AgentResults, Run
from evaluator.report.attachments import FILMS, FRAMES, film_name
from evaluator.report.call_rows import TurnCalls, calls_of, motion_charts
from evaluator.report.charts import Chart
from evaluator.report.evidence import evidence_charts, verdict_of
from evaluator.scores.grounding import Assertion
from evaluator.scores.scored_episode import ScoredEpisode
from scenes import PackFiles, default_folder, list_packs, same_pack


def pictures(played: Mapping[str, str], scenes_dir: Path | None = None) -> dict[int, bytes]:
    """Scene → PNG image, for the scenes of a run whose packs have the same content as the packs in the folder.

    Args:
        played: Scene → hash of the pack that was played.
        scenes_dir: Folder of packs; the suite's own if None.
    """
    if not pictures_folder(scenes_dir).is_dir():
        return {}
    packs = [files for files in list_packs(scenes_dir) if str(files.scene_id) in played]
    return thumbnails([files for files in packs if same_pack(played[str(files.scene_id)], files)], scenes_dir)


def thumbnails(packs: Sequence[PackFiles], scenes_dir: Path | None = None) -> dict[int, bytes]:
    """Scene → PNG image, for the packs that have an image."""
    folder = pictures_folder(scenes_dir) / "small"
    stored = {files.scene_id: folder / f"scene{files.scene_id}.png" for files in packs}
    return {scene: path.read_bytes() for scene, path in stored.items() if path.is_file()}


def pictures_folder(scenes_dir: Path | None = None) -> Path:
    """Path of the folder of scene images: `docs/reference/scenes`, beside the folder of packs.

    An installed package has no such folder; reports then show no images.
    """
    return (scenes_dir or default_folder()).resolve().parent / "docs" / "reference" / "scenes"


_LINE = 92
"""Largest length of JSON that is kept on one line [characters]."""

SHOWN_CHARS = 1_000_000
"""Largest number of characters of an episode in a report: reasoning, arguments and results. The rest is omitted."""


class Passage(NamedTuple):
    """A part of the reasoning text: a number, or the text between two numbers."""

    text: str
    assertion: Assertion | None = None
    """The number with its source in the readings; None for text."""


@dataclass(frozen=True, slots=True)
class Entry:
    """An episode in the list of a report."""

    number: int
    """Number of the episode in the report, from 1."""
    row: ScoredEpisode
    label: str
    """Scene and seed, or the number of a held-back variant, and budget and epoch if the report has several."""
    agent_index: int
    """Index of the agent's results in the report."""
    agent_label: str
    """Label of the agent's results."""
    run: Run
    """The run that contains the episode."""
    picture: str
    """Base64-encoded PNG image of the scene's start state; empty if there is none."""
    charts: Sequence[Chart]
    """Charts of readings over time, for the objects that moved."""

    @property
    def evidence_charts(self) -> list[Chart]:
        """Charts of the error bound of the answer against the number of calls."""
        return evidence_charts(self.row)

    @property
    def evidence_verdict(self) -> str:
        """The verdict on its evidence; see `verdict_of`."""
        return verdict_of(self.row)

    @property
    def id(self) -> str:
        """HTML id of the episode in the page."""
        return f"episode-{self.number}"

    @property
    def shown_turns(self) -> int:
        """Number of turns shown, limited by `SHOWN_CHARS`; at least one."""
        size = 0
        for number, turn in enumerate(self.row.episode.turns):
            size += len(turn.reasoning) + sum(_size(exchange) for exchange in turn.exchanges)
            if size > SHOWN_CHARS:
                return max(1, number)
        return len(self.row.episode.turns)

    @property
    def is_held_back(self) -> bool:
        """Whether seeds are held back, so that the seed in the episode's key is the number of a variant."""
        return bool(self.run.record.plan.held_back)

    @property
    def film(self) -> str:
        """Relative URL of the film; empty if there is none."""
        return f"{FILMS}/{film_name(self.record_sha256)}" if self.record_sha256 else ""

    @property
    def record_sha256(self) -> str:
        """SHA-256 of the record that the film shows; empty if there is no film."""
        return self.run.attachments.films.get(self.row.key, "")

    def frame(self, frame: Frame) -> str:
        """Relative URL of a frame; empty if the frame is missing."""
        return f"{FRAMES}/{frame.name}.png" if frame.name in self.run.attachments.frames else ""

    @property
    def forked_turns(self) -> int:
        """Number of turns at the start that were replayed from another episode."""
        fork = self.row.episode.forked_from
        return fork.turn if fork else 0

    def calls(self) -> list[TurnCalls]:
        """The table rows of the shown turns."""
        return calls_of(self.row.episode.turns[: self.shown_turns])

    def thought(self, turn: int) -> Iterator[Passage]:
        """The reasoning summary from the provider in a turn, split at the numbers that it contains."""
        return self._passages(turn, 0, self.row.episode.turns[turn].thought_chars)

    def reply(self, turn: int) -> Iterator[Passage]:
        """The agent's reply in a turn, split at the numbers that it contains."""
        played = self.row.episode.turns[turn]
        return self._passages(turn, played.thought_chars, len(played.reasoning))

    def _passages(self, turn: int, begin: int, end: int) -> Iterator[Passage]:
        text = self.row.episode.turns[turn].reasoning
        for assertion in self.row.grounding.assertions:
            if assertion.turn == turn and begin <= assertion.start < end:
                yield Passage(text[begin : assertion.start])
                yield Passage(text[assertion.start : assertion.end], assertion)
                begin = assertion.end
        yield Passage(text[begin:end])


def entries(results: Sequence[AgentResults]) -> Iterator[Entry]:
    """The episodes in order of scene, seed and budget."""
    found = [(index, row) for index, result in enumerate(results) for row in result.rows]
    found.sort(key=lambda pair: (_order(pair[1].key), pair[0]))
    varying = [name for name in ("budget", "epoch") if len({getattr(row.key, name) for _, row in found}) > 1]
    for number, (index, row) in enumerate(found, start=1):
        yield Entry(
            number=number,
            row=row,
            label=_label(row, varying, "variant" if results[index].run.record.plan.held_back else "seed"),
            agent_index=index,
            agent_label=results[index].label,
            run=results[index].run,
            picture=base64.b64encode(results[index].run.pictures.get(row.key.scene, b"")).decode(),
            charts=motion_charts(row.episode.turns),
        )


def _order(key: EpisodeKey) -> tuple[int, ...]:
    return (key.scene, key.seed, key.budget, key.epoch)


def _label(row: ScoredEpisode, varying: Sequence[str], seed: str) -> str:
    key = row.key
    which = (f"{name} {getattr(key, name)}" for name in varying)
    return ", ".join([f"Scene {row.scene_title}", f"{seed} {key.seed}", *which])


def _size(exchange: Exchange) -> int:
    return len(exchange.text) + len(json.dumps(exchange.call.arguments))


_QUESTION = re.compile(r"^# Scene: [^\n]*\n+(.*?)(?=\n# |\Z)", re.DOTALL | re.MULTILINE)


def question(prompt: str) -> str:
    """The task in an opening prompt: the text after the name of the scene; empty if there is none."""
    found = _QUESTION.search(prompt)
    return found[1].strip() if found else ""


def returned(exchange: Exchange) -> str:
    """The result text that the agent read, with JSON formatted over several lines."""
    try:
        text = laid_out(json.loads(exchange.text))
        text.encode()  # JSON may contain an escaped lone surrogate, which UTF-8 cannot encode
    except (ValueError, RecursionError):
        return exchange.text
    return text


def laid_out(value: Any, indent: str = "") -> str:
    """Format JSON, breaking only values too long for one line, so that a vector stays on one line."""
    flat = json.dumps(value, ensure_ascii=False)
    if len(indent) + len(flat) <= _LINE or not isinstance(value, dict | list) or not value:
        return flat
    deeper = indent + "  "
    if isinstance(value, dict):
        named = cast(dict[str, Any], value)
        parts = [f"{json.dumps(name, ensure_ascii=False)}: {laid_out(part, deeper)}" for name, part in named.items()]
        return "{\n" + ",\n".join(deeper + part for part in parts) + f"\n{indent}}}"
    parts = [laid_out(part, deeper) for part in cast(list[Any], value)]
    return "[\n" + ",\n".join(deeper + part for part in parts) + f"\n{indent}]"
