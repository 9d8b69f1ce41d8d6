"""Input and output of the detectors: the expected answer form; a failure mode with evidence. Knows no rules."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from pydantic import Field

from evaluator.answers.forms import plain_number
from evaluator.answers.strict import AnswerKey
from evaluator.records.episode import Episode, Record
from scenes.answer_spec import AnswerKind

_QUOTE_CHARS = 160
_SENTENCE_END = re.compile(r"(?<=[.!?])\s|\n")


class FailureMode(StrEnum):
    """The six ways in which episodes fail, from the paper's error analysis.

    A failure mode is not a verdict: a right answer may be premature, and an episode may show several modes.
    """

    PREMATURE_ANSWER = "premature_answer"
    """Answered before it had seen any reading, with iterations left."""
    TOO_LITTLE_TIME = "too_little_simulated_time"
    """Answered about motion after too little simulated time to see it."""
    ANSWER_FORMAT = "answer_format_mismatch"
    """Answered in a form that the question does not ask for."""
    OBJECT_ID = "object_id_confusion"
    """Used an object id that it had not been given, or gave an object the id of another one."""
    WRONG_PARAMETER = "wrong_parameter"
    """Called a tool with arguments that do not fit, or with a mass that differs from the measured one."""
    THEORY_OR_SIMULATION = "theory_over_simulation_or_reverse"
    """Answered from theory without or against the readings, or from readings that it believed wrong."""


@dataclass(frozen=True, slots=True)
class ExpectedForm:
    """The form of answer that a question asks for, without the key. The detectors know nothing else about a pack."""

    kind: AnswerKind
    parts: int | None
    """Number of values in a list; None for a single answer."""
    is_numeric: bool
    """Whether every part of the key is a number: a quantity, or the number of an object or option."""
    options: tuple[str, ...] = ()
    objects: Mapping[str, str] = field(default_factory=dict[str, str])
    """Object id, such as `object_2` → public name."""
    task: str = ""
    """The question whose answer has this form; empty if unknown."""

    def was_asked(self, prompt: str) -> bool:
        """Whether a prompt asks this question. A published log may ask an older one, with an answer of another form."""
        return _words(self.task) in _words(prompt)


def _words(text: str) -> str:
    return " ".join(text.split()).rstrip(".")


def expected_form(key: AnswerKey, task: str = "") -> ExpectedForm:
    """The expected form of an answer; it is the same for all seeds of a scene.

    Args:
        key: The key at any seed.
        task: The question as the pack words it.
    """
    return ExpectedForm(
        kind=key.spec.kind,
        parts=len(key.value) if isinstance(key.value, tuple) else None,
        is_numeric=all(plain_number(part) is not None for part in key.parts),
        options=key.spec.options,
        objects=key.objects,
        task=task,
    )


class Evidence(Record):
    """One place in a transcript that shows a failure."""

    turn: int
    """Index of the turn, from 0."""
    exchange: int | None = None
    """Index of the exchange within the turn, from 0; None if the evidence is in the reasoning."""
    quote: str = ""
    """A sentence that the agent or the laboratory wrote there."""
    numbers: dict[str, float] = Field(default_factory=dict[str, float])
    """Counted or measured values; their names end in the unit: `simulated_s`."""


class Failure(Record):
    """One failure mode of an episode."""

    mode: FailureMode
    explanation: str
    """One sentence for the reader of the report. It never contains the key."""
    evidence: tuple[Evidence, ...]


def quote_at(text: str, start: int = 0) -> str:
    """The sentence or line around a position in a text, shortened for the report."""
    ends = [found.start() for found in _SENTENCE_END.finditer(text)]
    begin = max((end + 1 for end in ends if end < start), default=0)
    end = min((end for end in ends if end > start), default=len(text))
    begin = max(begin, start - _QUOTE_CHARS // 2)
    sentence = text[begin:end].strip()
    return sentence if len(sentence) <= _QUOTE_CHARS else sentence[: _QUOTE_CHARS - 1] + "…"


def answering_turn(episode: Episode) -> int:
    """Index of the turn with the answer, which is the last turn of an answered episode."""
    return len(episode.turns) - 1
