"""What a detector says: the mode, a sentence, and the places of the transcript that show it. Knows no rules."""

import re
from enum import StrEnum

from pydantic import Field

from evaluator.records import Episode, Record

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
    """Named an object that does not exist, or one object by the number of another."""
    WRONG_PARAMETER = "wrong_parameter"
    """Called a tool with arguments that do not fit, or with another mass than was measured."""
    THEORY_OR_SIMULATION = "theory_over_simulation_or_reverse"
    """Took the answer from theory without or against the readings, or from readings held to be wrong."""


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
