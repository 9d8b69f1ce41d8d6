"""What detectors are given and say: the form of an answer; a mode, a sentence and its evidence. Knows no rules."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from pydantic import Field

from evaluator.answers.forms import plain_number
from evaluator.answers.strict import AnswerKey
from evaluator.records import Episode, Record
from scenes.pack import AnswerKind

_QUOTE_CHARS = 160
_SENTENCE_END = re.compile(r"(?<=[.!?])\s|\n")


class FailureMode(StrEnum):
    """The six ways in which episodes fail, after the paper's error analysis.

    They are no verdict: a right answer may be premature, and an episode may show several.
    """

    PREMATURE_ANSWER = "premature_answer"
    """Answered before a single reading was read, with iterations left."""
    TOO_LITTLE_TIME = "too_little_simulated_time"
    """Judged motion after less simulated time than it shows itself in."""
    ANSWER_FORMAT = "answer_format_mismatch"
    """Answered in another form than was asked for."""
    OBJECT_ID = "object_id_confusion"
    """Named an object of which it had not been told, or one object by the number of another."""
    WRONG_PARAMETER = "wrong_parameter"
    """Called a tool with arguments that do not fit, or with another mass than was measured."""
    THEORY_OR_SIMULATION = "theory_over_simulation_or_reverse"
    """Took the answer from theory without or against the readings, or from readings held to be wrong."""


@dataclass(frozen=True, slots=True)
class AnswerForm:
    """What a question asks for, without what is right: all that the detectors know of a pack."""

    kind: AnswerKind
    parts: int | None
    """How many values a list holds; None where a single answer is asked for."""
    is_numeric: bool
    """Whether every part of the key is a number, be it a quantity or the number of an object or of a case."""
    options: tuple[str, ...] = ()
    objects: Mapping[str, str] = field(default_factory=dict[str, str])
    """Ids of the scene's objects, such as `object_2`, and their public names."""


def form_of(key: AnswerKey) -> AnswerForm:
    """The form of an answer; the same for the keys of all seeds of a scene."""
    return AnswerForm(
        kind=key.spec.kind,
        parts=len(key.value) if isinstance(key.value, tuple) else None,
        is_numeric=all(plain_number(part) is not None for part in key.parts),
        options=key.spec.options,
        objects=key.objects,
    )


class Evidence(Record):
    """One place of a transcript."""

    turn: int
    """Index of the turn, from 0."""
    exchange: int | None = None
    """Index of the exchange within the turn, from 0; None where the reasoning is meant."""
    quote: str = ""
    """What the agent or the laboratory wrote there, cut to a sentence."""
    numbers: dict[str, float] = Field(default_factory=dict[str, float])
    """What was counted or measured, by name with its unit: `simulated_s`."""


class Failure(Record):
    """One failure mode of an episode."""

    mode: FailureMode
    explanation: str
    """One sentence for a reader of the report; never tells the key."""
    evidence: tuple[Evidence, ...]


def quote_at(text: str, start: int = 0) -> str:
    """The sentence or line of a text that holds a place, cut to what a report can show."""
    ends = [found.start() for found in _SENTENCE_END.finditer(text)]
    begin = max((end + 1 for end in ends if end < start), default=0)
    end = min((end for end in ends if end > start), default=len(text))
    begin = max(begin, start - _QUOTE_CHARS // 2)
    sentence = text[begin:end].strip()
    return sentence if len(sentence) <= _QUOTE_CHARS else sentence[: _QUOTE_CHARS - 1] + "…"


def answering_turn(episode: Episode) -> int:
    """Index of the turn that answered: the last one of an answered episode."""
    return len(episode.turns) - 1
