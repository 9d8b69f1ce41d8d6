"""One episode as the report shows it: a label, its reasoning in passages, its returns in lines. Knows no page."""

import base64
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

from evaluator.records import EpisodeKey, Exchange, GradeRecord
from evaluator.report.charts import Chart
from evaluator.report.contenders import Contender
from evaluator.report.motion import motion_charts
from evaluator.scores.grounding import Assertion, Support, grounding_of
from evaluator.scores.metrics import EpisodeScores, ScoredEpisode, dimensions

_LINE = 92
"""Characters of JSON that stay on one line."""


class Passage(NamedTuple):
    """A piece of reasoning; where it states a number, with the return behind that number."""

    text: str
    asserted: bool
    support: Support | None


@dataclass(frozen=True, slots=True)
class Entry:
    """An episode with its grade and scores."""

    number: int
    """Place in the report, from 1."""
    row: ScoredEpisode
    record: GradeRecord
    scores: EpisodeScores
    assertions: Sequence[Assertion]
    label: str
    """Scene, seed, and what else tells it from others of its contender."""
    contender: int
    """Index of its contender."""
    who: str
    """Label of its contender."""
    picture: str
    """The scene's start as a PNG in base64; empty if there is none."""
    charts: Sequence[Chart]
    """How what moved moved."""

    @property
    def id(self) -> str:
        """Its anchor in the page."""
        return f"episode-{self.number}"

    def passages(self, turn: int) -> Iterator[Passage]:
        """The reasoning of a turn, cut at the numbers it states."""
        text, done = self.row.episode.turns[turn].reasoning, 0
        for one in self.assertions:
            if one.turn == turn:
                yield Passage(text[done : one.start], asserted=False, support=None)
                yield Passage(text[one.start : one.end], asserted=True, support=one.support)
                done = one.end
        yield Passage(text[done:], asserted=False, support=None)


def entries(who: Sequence[Contender]) -> Iterator[Entry]:
    """The episodes in order of scene, seed and budget, labelled by what tells them apart."""
    found = [(index, row) for index, one in enumerate(who) for row in one.rows]
    found.sort(key=lambda pair: (_order(pair[1].episode.key), pair[0]))
    varying = [name for name in ("budget", "epoch") if len({getattr(row.episode.key, name) for _, row in found}) > 1]
    for number, (index, row) in enumerate(found, start=1):
        run, key, grounding = who[index].run, row.episode.key, grounding_of(row.episode)
        yield Entry(
            number=number,
            row=row,
            record=run.grades[key],
            scores=dimensions(row.episode, row.grade, row.disabled_tools, grounding),
            assertions=grounding.assertions,
            label=_label(key, varying),
            contender=index,
            who=who[index].label,
            picture=base64.b64encode(run.pictures.get(key.scene, b"")).decode(),
            charts=motion_charts(row.episode.turns),
        )


def _order(key: EpisodeKey) -> tuple[int, ...]:
    return (key.scene, key.seed, key.budget, key.epoch)


def _label(key: EpisodeKey, varying: Sequence[str]) -> str:
    return ", ".join([f"Scene {key.scene}", f"seed {key.seed}", *(f"{name} {getattr(key, name)}" for name in varying)])


def returned(exchange: Exchange) -> str:
    """What the agent read of a call, JSON laid out in lines."""
    try:
        text = laid_out(json.loads(exchange.text))
        text.encode()  # an escaped half of a surrogate pair is JSON, but no text to write
    except (ValueError, RecursionError):
        return exchange.text
    return text


def laid_out(value: Any, indent: str = "") -> str:
    """JSON that breaks lines only where they would be too long, so that a vector stays a line."""
    flat = json.dumps(value, ensure_ascii=False)
    if len(indent) + len(flat) <= _LINE or not isinstance(value, dict | list) or not value:
        return flat
    deeper = indent + "  "
    if isinstance(value, dict):
        named = cast(dict[str, Any], value)
        parts = [f"{json.dumps(name, ensure_ascii=False)}: {laid_out(one, deeper)}" for name, one in named.items()]
        return "{\n" + ",\n".join(deeper + part for part in parts) + f"\n{indent}}}"
    parts = [laid_out(one, deeper) for one in cast(list[Any], value)]
    return "[\n" + ",\n".join(deeper + part for part in parts) + f"\n{indent}]"
