"""Failure modes, evidence, and queries on an episode's readings and actions that the detectors share."""

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, NamedTuple

from pydantic import Field

from evaluator.answers.forms import plain_number
from evaluator.answers.strict import AnswerKey
from evaluator.records.episode import Episode, Exchange, Grade, Outcome, Record, Verdict
from scenes import AnswerKind

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
        """Return whether a prompt contains `task`. The prompt in a published log may ask an older question instead."""
        return _words(self.task) in _words(prompt)


def _words(text: str) -> str:
    return " ".join(text.split()).rstrip(".")


def expected_form(key: AnswerKey, task: str = "") -> ExpectedForm:
    """Return the expected form of an answer, which is the same for all seeds of a scene.

    Args:
        key: The key at any seed.
        task: The question in the pack's words.
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
    """A location in a transcript that shows a failure."""

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
    """Return the sentence or line around a position in a text, truncated for the report."""
    ends = [found.start() for found in _SENTENCE_END.finditer(text)]
    begin = max((end + 1 for end in ends if end < start), default=0)
    end = min((end for end in ends if end > start), default=len(text))
    begin = max(begin, start - _QUOTE_CHARS // 2)
    sentence = text[begin:end].strip()
    return sentence if len(sentence) <= _QUOTE_CHARS else sentence[: _QUOTE_CHARS - 1] + "…"


def answering_turn(episode: Episode) -> int:
    """Return the index of the turn with the answer: the last turn of an answered episode."""
    return len(episode.turns) - 1


ANSWER = "answer"
STEP = "step"

ACTIONS = frozenset(
    {
        *("apply_force", "apply_torque", "set_velocity", "move_object", "change_position"),
        *("create_objects", "delete_objects", "attach_objects"),
    }
)
"""Tools that change the state. Their result repeats the request, so it is not a reading."""

PUSHES = frozenset({"apply_force", "apply_torque", "set_velocity"})
"""Actions that set an object in motion."""

MOTION_READINGS = frozenset(
    {
        *("get_velocity", "get_acceleration", "get_displacement", "get_momentum", "get_angular_momentum"),
        *("get_kinetic_energy", "get_rotational_energy", "compute_force", "detect_collision", "get_torque"),
    }
)
"""Tools that read motion or contact, which are uninformative before time has passed."""

_STILL = 1e-9
"""Largest absolute value that counts as 0 because of rounding."""
_NO_READINGS = ACTIONS | {ANSWER, STEP, "quat_to_rot_matrix"}
_ID_ARGUMENTS = ("object_id", "obj1_id", "obj2_id", "object1_id", "object2_id")


class Place(NamedTuple):
    """An exchange and its position in the episode."""

    turn: int
    position: int
    """Index of the exchange within the turn, from 0."""
    exchange: Exchange

    @property
    def tool(self) -> str:
        """Name of the tool."""
        return self.exchange.call.tool

    @property
    def arguments(self) -> dict[str, Any]:
        """The arguments of the call."""
        return self.exchange.call.arguments


def exchanges(episode: Episode) -> Iterator[Place]:
    """Yield all exchanges with their positions, in order."""
    for number, turn in enumerate(episode.turns):
        for index, exchange in enumerate(turn.exchanges):
            yield Place(number, index, exchange)


def succeeded(place: Place) -> bool:
    """Whether a call ran and returned no error."""
    return place.exchange.returned and not place.exchange.is_error


def is_reading(place: Place) -> bool:
    """Whether a call succeeded and its result contains information that its arguments do not."""
    return succeeded(place) and place.tool not in _NO_READINGS


def shows_motion(place: Place) -> bool:
    """Whether a reading of motion or contact has a non-zero value."""
    return place.tool in MOTION_READINGS and any(abs(value) > _STILL for value in measured_numbers(place))


def measured_numbers(place: Place) -> Iterator[float]:
    """Yield all numbers in a result except the clock and the number of time steps; true counts as 1."""
    content = place.exchange.content or {}
    return _numbers({name: value for name, value in content.items() if name not in {"sim_time", "time", "steps"}})


def _numbers(value: Any) -> Iterator[float]:
    """Yield all numbers in a JSON value; true counts as 1."""
    if isinstance(value, dict):
        value = list(value.values())  # pyright: ignore[reportUnknownVariableType, reportUnknownArgumentType] - JSON
    if isinstance(value, list):
        for part in value:  # pyright: ignore[reportUnknownVariableType] - JSON
            yield from _numbers(part)
    elif isinstance(value, int | float):
        yield float(value)


def has_answered(episode: Episode) -> bool:
    """Whether the episode ended with an answer."""
    return episode.outcome is Outcome.ANSWERED and bool(episode.turns)


def read_before_answer(episode: Episode) -> list[Place]:
    """Return the readings that the agent had seen when it wrote its answer: those of the turns before."""
    return [place for place in exchanges(episode) if place.turn < len(episode.turns) - 1 and is_reading(place)]


def step_duration(place: Place) -> float | None:
    """Return the duration of a successful `step` call [s]; None for any other call."""
    duration = place.arguments.get("duration")
    if place.tool != STEP or not succeeded(place) or isinstance(duration, bool):
        return None
    return float(duration) if isinstance(duration, int | float) else None


def objects_named(place: Place) -> list[str]:
    """Return the object ids in a call's arguments, as written."""
    return [str(place.arguments[name]) for name in _ID_ARGUMENTS if name in place.arguments]


class FailureCount(Record):
    """Number of episodes that show a failure mode. One episode may show several modes, so the counts overlap."""

    n: int
    """Among the scored episodes."""
    n_incorrect: int
    """Among the strictly incorrect episodes."""


def failure_counts(episodes: Iterable[tuple[Grade, tuple[Failure, ...]]]) -> dict[FailureMode, FailureCount]:
    """Count each failure mode over the scored episodes. Every mode has an entry, even if its count is 0.

    Args:
        episodes: The grade and the failures of each episode.
    """
    shown = [
        (failure.mode, grade.strict is Verdict.INCORRECT)
        for grade, failures in episodes
        if grade.strict is not Verdict.UNSCORED
        for failure in failures
    ]
    return {
        mode: FailureCount(
            n=sum(found is mode for found, _ in shown),
            n_incorrect=sum(found is mode and incorrect for found, incorrect in shown),
        )
        for mode in FailureMode
    }
