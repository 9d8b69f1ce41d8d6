"""What a run leaves on disk: frozen records, one schema with a format number. Knows no files and no verdict rules."""

from collections.abc import Iterable
from enum import StrEnum
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, JsonValue

FORMAT = 1
"""Version of the on-disk schema; readers refuse a higher one."""


class Record(BaseModel):
    """Base of all records: frozen, closed, finite numbers only."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True)


class Outcome(StrEnum):
    """How an episode ended; says nothing about right or wrong."""

    ANSWERED = "answered"
    BUDGET_EXHAUSTED = "budget_exhausted"
    AGENT_ERROR = "agent_error"
    INFRASTRUCTURE_ERROR = "infrastructure_error"


class ToolCall(Record):
    """One tool call as the agent wrote it."""

    tool: str
    arguments: dict[str, Any]


class Exchange(Record):
    """A call and what came back; `returned` is false where the call was not run."""

    call: ToolCall
    returned: bool
    is_error: bool = False
    content: dict[str, Any] | None = None
    """The structured result of a successful call."""
    text: str = ""
    """The text the agent read: the result as compact JSON, or one sentence that says what was wrong."""
    duration_s: float = 0.0


class Usage(Record):
    """Tokens of one model request, or a sum of them."""

    input_tokens: int = 0
    output_tokens: int = 0
    cached_tokens: int = 0
    cost_usd: float | None = None


def total_usage(parts: Iterable[Usage]) -> Usage | None:
    """The sum; None for no parts. Its cost is that of the parts whose cost is known."""
    used = list(parts)
    if not used:
        return None
    costs = [one.cost_usd for one in used if one.cost_usd is not None]
    return Usage(
        input_tokens=sum(one.input_tokens for one in used),
        output_tokens=sum(one.output_tokens for one in used),
        cached_tokens=sum(one.cached_tokens for one in used),
        cost_usd=sum(costs) if costs else None,
    )


class Turn(Record):
    """One iteration: what the agent said, called, and got back."""

    reasoning: str
    exchanges: tuple[Exchange, ...] = ()
    note: str = ""
    """What the loop told the agent apart from returns: malformed reply, call that fits no schema, no call at all."""
    usage: Usage | None = None
    agent_s: float = 0.0
    server_s: float = 0.0


class Versions(Record):
    """Versions that decide a result."""

    physment: str
    protocol: str
    pack: str


class EpisodeKey(Record):
    """What makes two episodes the same cell of the matrix."""

    scene: int
    seed: int
    agent: str
    budget: int
    prompting: str = "zero-shot"
    protocol: str = "native"
    epoch: int = 1


class Episode(Record):
    """One agent, one scene, one budget, from opening prompt to outcome."""

    format: Literal[1] = FORMAT
    key: EpisodeKey
    outcome: Outcome
    answer: JsonValue = None
    """What `answer` was called with, verbatim; null unless the outcome is `answered`."""
    prompt: str
    turns: tuple[Turn, ...]
    error: str | None = None
    """Why the episode ended early, for the two error outcomes."""
    unsealed: str | None = None
    """Why the agent could have known more than it measured, such as the answers; null if it could not."""
    attempts: int = 1
    """How many times the episode was opened, this one included."""
    max_calls: int | None = None
    """Most tool calls, where turns cannot be seen and calls are limited instead of iterations."""
    usage: Usage | None = None
    """Of all attempts: what one used that failed was paid for too, though its turns are not here."""
    started_at: str
    duration_s: float
    versions: Versions

    @property
    def allowance(self) -> int:
        """Most turns: the iteration budget, or calls where these are limited, since each is then a turn of its own."""
        return self.max_calls or self.key.budget


class Verdict(StrEnum):
    """Right or wrong."""

    CORRECT = "correct"
    INCORRECT = "incorrect"
    UNSCORED = "unscored"
    """Infrastructure errors: retried or counted apart, never wrong."""


class NormalisationClass(StrEnum):
    """The four documented ways in which normalised grading forgives a strict fail."""

    OBJECT_NOTATION = "equivalent_object_notation"
    TRIVIAL_ROUNDING = "trivial_rounding"
    CONCEPTUAL = "conceptual_description"
    ANSWER_FORMAT = "partial_answer_format"


class Grade(Record):
    """The verdicts on one answer, with their reasons."""

    strict: Verdict
    graded: float | None
    """Share of sub-answers within tolerance, 0 to 1; null where unscored."""
    normalised: Verdict
    normalisation: NormalisationClass | None = None
    """Set where normalised differs from strict."""
    reason: str


class GradeRecord(Record):
    """A line of `grades.jsonl`."""

    format: Literal[1] = FORMAT
    key: EpisodeKey
    grade: Grade
    answer_key: JsonValue
    grader_version: str
    pack_version: str
