"""Episodes and grades, as frozen records with a format number. Knows no files and no rules of grading."""

import hashlib
from collections.abc import Iterable
from enum import StrEnum
from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, JsonValue

FORMAT = 1
"""Version of the format on disk. Readers refuse a higher version."""


def is_absent(value: object) -> bool:
    """Whether a field is left out of the file."""
    return not value


class Record(BaseModel):
    """Base of all records: frozen, no unknown fields, only finite numbers."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True)


class Outcome(StrEnum):
    """How an episode ended. Does not say whether the answer is right."""

    ANSWERED = "answered"
    BUDGET_EXHAUSTED = "budget_exhausted"
    AGENT_ERROR = "agent_error"
    INFRASTRUCTURE_ERROR = "infrastructure_error"


class ToolCall(Record):
    """One tool call as the agent wrote it."""

    tool: str
    arguments: dict[str, Any]


class Frame(Record):
    """A picture of what could be seen, which came with a result, as PNG."""

    name: str = Field(pattern=r"^[0-9a-f]{24}$")
    """Hash of its content. Its file in the run folder is `frames/{name}.png`."""
    png: bytes = Field(default=b"", exclude=True, repr=False)
    """The content; empty in records that were read from disk."""

    @classmethod
    def of(cls, png: bytes) -> Self:
        """The frame with this content."""
        return cls(name=hashlib.sha256(png).hexdigest()[:24], png=png)


class Exchange(Record):
    """A call and its return."""

    call: ToolCall
    returned: bool
    """False if the call was not run."""
    is_error: bool = False
    content: dict[str, Any] | None = None
    """The structured result of a successful call."""
    text: str = ""
    """The text that the agent read: the result as compact JSON, or a sentence that says what was wrong."""
    duration_s: float = 0.0
    frames: tuple[Frame, ...] = Field(default=(), exclude_if=is_absent)
    """What the agent saw with the text; absent if nothing."""


class Usage(Record):
    """Tokens and cost of one request to a model, or of several together."""

    input_tokens: int = 0
    output_tokens: int = 0
    cached_tokens: int = 0
    cost_usd: float | None = None


def total_usage(parts: Iterable[Usage]) -> Usage | None:
    """The sum; None if there are no parts. Its cost includes only the parts with a known cost."""
    used = list(parts)
    if not used:
        return None
    costs = [part.cost_usd for part in used if part.cost_usd is not None]
    return Usage(
        input_tokens=sum(part.input_tokens for part in used),
        output_tokens=sum(part.output_tokens for part in used),
        cached_tokens=sum(part.cached_tokens for part in used),
        cost_usd=sum(costs) if costs else None,
    )


UNREAD = "Your reply could not be read, so nothing was run"
"""Start of the note of a turn whose reply could not be read, for example because it had two lists of calls."""


class Turn(Record):
    """One iteration: what the agent said, its calls, and their returns."""

    reasoning: str
    thought_chars: int = 0
    """Characters at the start of `reasoning` that are not the reply, but what the provider shows of the model's own
    reasoning."""
    exchanges: tuple[Exchange, ...] = ()
    note: str = ""
    """What the loop told the agent besides returns: malformed reply, call that fits no schema, no call at all."""
    usage: Usage | None = None
    agent_s: float = 0.0
    server_s: float = 0.0

    @property
    def is_unread(self) -> bool:
        """Whether the reply could not be read, so that none of its calls was run."""
        return self.note.startswith(UNREAD)


class Versions(Record):
    """Versions that decide the result of an episode."""

    physment: str
    protocol: str
    pack: str


class EpisodeKey(Record):
    """Identifies an episode: episodes with equal keys are the same cell of the matrix."""

    scene: int
    seed: int
    agent: str
    budget: int
    prompting: str = "zero-shot"
    protocol: str = "native"
    epoch: int = 1


class Fork(Record):
    """Where an episode comes from that goes on from the turns of another one."""

    key: EpisodeKey
    """Key of the other episode."""
    turn: int
    """How many of its turns were played again; the agent took the ones after them."""
    record_sha256: str
    """Of the line of the other episode in its `episodes.jsonl`."""


class Episode(Record):
    """One episode, from its opening prompt to its outcome."""

    format: Literal[1] = FORMAT
    key: EpisodeKey
    outcome: Outcome
    answer: JsonValue = None
    """The argument of `answer`, verbatim; null unless the outcome is `answered`."""
    prompt: str
    turns: tuple[Turn, ...]
    error: str | None = None
    """Why the episode ended early, for the two error outcomes."""
    unsealed: str | None = None
    """Why the agent could have known more than it measured, such as the answers; null if it could not."""
    attempts: int = 1
    """How many times the episode was opened, including this time."""
    max_calls: int | None = None
    """Most tool calls, for agents whose turns cannot be seen, so that calls are limited instead of iterations."""
    usage: Usage | None = None
    """Usage of all attempts: a failed attempt was paid for too, although its turns are not recorded."""
    started_at: str
    duration_s: float
    versions: Versions
    forked_from: Fork | None = Field(default=None, exclude_if=is_absent)
    """The episode whose first turns these are; absent if the agent took every turn."""

    @property
    def allowance(self) -> int:
        """Most turns: the iteration budget; or the limit of calls, if there is one, since each call is then a turn."""
        return self.max_calls or self.key.budget


class Verdict(StrEnum):
    """Right or wrong."""

    CORRECT = "correct"
    INCORRECT = "incorrect"
    UNSCORED = "unscored"
    """Ended by an infrastructure error: retried or counted apart, never wrong."""


class NormalisationClass(StrEnum):
    """The four documented reasons for which normalised grading accepts an answer that strict grading rejects."""

    OBJECT_NOTATION = "equivalent_object_notation"
    TRIVIAL_ROUNDING = "trivial_rounding"
    CONCEPTUAL = "conceptual_description"
    ANSWER_FORMAT = "partial_answer_format"


class Grade(Record):
    """The verdicts on one answer, with their reasons."""

    strict: Verdict
    graded: float | None
    """Share of sub-answers within tolerance, from 0 to 1; null if unscored."""
    normalised: Verdict
    normalisation: NormalisationClass | None = None
    """Set if the normalised verdict differs from the strict one."""
    reason: str
    steps: dict[str, bool] | None = Field(default=None, exclude_if=is_absent)
    """Intermediate quantity → whether it is stated beside the answer and right; absent if the scene names none. No part
    of the verdicts."""


class GradeRecord(Record):
    """A line of `grades.jsonl`."""

    format: Literal[1] = FORMAT
    key: EpisodeKey
    grade: Grade
    answer_key: JsonValue
    grader_version: str
    pack_version: str
