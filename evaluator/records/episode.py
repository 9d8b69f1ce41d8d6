"""Episodes and grades as frozen records with a format number. Contains no file access and no grading."""

import hashlib
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from enum import StrEnum
from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, JsonValue

FORMAT = 1
"""Version of the on-disk format. Readers refuse a higher version."""
_ANSWER = "answer"


def timestamp(timespec: str = "milliseconds") -> str:
    """The present time in UTC, in ISO 8601, as records state it."""
    return datetime.now(UTC).isoformat(timespec=timespec)


def is_absent(value: object) -> bool:
    """Return whether a field is omitted from the file."""
    return not value


class Record(BaseModel):
    """Base class of all records: frozen, without unknown fields, with finite numbers only."""

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
    """An image that came with a result, as PNG: the scene as the agent may see it."""

    name: str = Field(pattern=r"^[0-9a-f]{24}$")
    """Hash of the content. The file in the run folder is `frames/{name}.png`."""
    png: bytes = Field(default=b"", exclude=True, repr=False)
    """The content; empty in records that were read from disk."""

    @classmethod
    def of(cls, png: bytes) -> Self:
        """Return the frame with this content."""
        return cls(name=hashlib.sha256(png).hexdigest()[:24], png=png)


class Exchange(Record):
    """A call and its result."""

    call: ToolCall
    returned: bool
    """False if the call was not run."""
    is_error: bool = False
    content: dict[str, Any] | None = None
    """The structured result of a successful call."""
    text: str = ""
    """The text that the agent read: the result as compact JSON, or an error message of one sentence."""
    duration_s: float = 0.0
    frames: tuple[Frame, ...] = Field(default=(), exclude_if=is_absent)
    """The images that came with the text; absent if there are none."""


class Usage(Record):
    """Tokens and cost of one model request, or of several together."""

    input_tokens: int = 0
    output_tokens: int = 0
    cached_tokens: int = 0
    cost_usd: float | None = None


def total_usage(parts: Iterable[Usage]) -> Usage | None:
    """Return the sum of usages; None if there are none. The cost includes only usages with a known cost."""
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
"""Prefix of the note of a turn whose reply could not be parsed, for example because it had two lists of calls."""


class Turn(Record):
    """One iteration: the agent's text, its calls, and their results."""

    reasoning: str
    thought_chars: int = 0
    """Number of characters at the start of `reasoning` that are the model's reasoning as the provider shows it, and not
    part of the reply."""
    exchanges: tuple[Exchange, ...] = ()
    note: str = ""
    """A message of the episode loop to the agent: malformed reply, call that fits no schema, or no call at all."""
    usage: Usage | None = None
    agent_s: float = 0.0
    server_s: float = 0.0

    @property
    def is_unread(self) -> bool:
        """Return whether the reply could not be parsed, so that none of its calls was run."""
        return self.note.startswith(UNREAD)


class Versions(Record):
    """Versions that determine the result of an episode."""

    physment: str
    protocol: str
    pack: str


class EpisodeKey(Record):
    """Identifies an episode. Episodes with equal keys belong to the same cell of the run's matrix."""

    scene: int
    seed: int
    agent: str
    budget: int
    prompting: str = "zero-shot"
    protocol: str = "native"
    epoch: int = 1


class Fork(Record):
    """The origin of an episode that continues another one."""

    key: EpisodeKey
    """Key of the original episode."""
    turn: int
    """Number of turns that were replayed; the agent took the following ones."""
    record_sha256: str
    """SHA-256 of the original episode's line in its `episodes.jsonl`."""


class Choice(Record):
    """Why an adaptive test chose an episode. All values but `rank` are in logits, on the scale of a calibration."""

    ability: float
    """Estimate of the ability before the episode."""
    se: float
    """Its standard error."""
    information: float
    """Fisher information about the ability that the episode was expected to give [1/logit²]."""
    rank: int
    """Rank of its scene by information among the scenes that could be chosen; 1 is the most informative."""
    difficulty: float
    """Difficulty of its scene."""
    difficulty_se: float
    """Standard error of the difficulty."""
    variant_sd: float
    """Standard deviation of variants around their scene."""


class Episode(Record):
    """One episode, from its opening prompt to its outcome."""

    format: Literal[1] = FORMAT
    key: EpisodeKey
    outcome: Outcome
    answer: JsonValue = None
    """The argument of `answer`, unchanged; null unless the outcome is `answered`."""
    prompt: str
    turns: tuple[Turn, ...]
    error: str | None = None
    """Reason for an early end, for the two error outcomes."""
    unsealed: str | None = None
    """Why the agent could have had other information than its measurements, such as the answers; null if it
    could not."""
    attempts: int = 1
    """Number of times that the episode was opened, this one included."""
    max_calls: int | None = None
    """Limit on tool calls, for agents whose turns cannot be observed, so that their iterations cannot be limited."""
    usage: Usage | None = None
    """Usage of all attempts. A failed attempt was paid for too, although its turns are not recorded."""
    started_at: str
    duration_s: float
    versions: Versions
    forked_from: Fork | None = Field(default=None, exclude_if=is_absent)
    """The episode whose first turns were replayed; absent if the agent took every turn."""
    chosen: Choice | None = Field(default=None, exclude_if=is_absent)
    """Why an adaptive test chose the episode; absent in other runs."""

    @property
    def allowance(self) -> int:
        """Return the largest number of turns: the limit on calls if there is one, otherwise the iteration budget."""
        return self.max_calls or self.key.budget

    def accepted_calls(self) -> Iterator[tuple[int, Exchange]]:
        """Yield the calls that the laboratory accepted, without the answer, each with the number of its turn."""
        for number, turn in enumerate(self.turns, start=1):
            for exchange in turn.exchanges:
                if exchange.returned and not exchange.is_error and exchange.call.tool != _ANSWER:
                    yield number, exchange


class Verdict(StrEnum):
    """Whether an answer is right or wrong."""

    CORRECT = "correct"
    INCORRECT = "incorrect"
    UNSCORED = "unscored"
    """The episode ended by an infrastructure error, or its pack is withdrawn. Counted separately, never as wrong."""


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
    """Share of the parts of the answer within tolerance, from 0 to 1; null if unscored."""
    normalised: Verdict
    normalisation: NormalisationClass | None = None
    """The reason for accepting the answer; null unless the normalised verdict differs from the strict one."""
    reason: str
    steps: dict[str, bool] | None = Field(default=None, exclude_if=is_absent)
    """Intermediate quantity → whether the agent stated it correctly with the answer; absent if the scene names none.
    Not part of the verdicts."""


class LawGrade(Record):
    """The grade of a law that was stated with the answer. It is not part of the verdicts on the answer."""

    version: str
    """Version of the rules."""
    sha256: str
    """First 16 digits of the hash of the law as JSON."""
    equivalent: bool
    """Whether the law predicts the same motion as the laboratory's law.

    Both errors below must be at most 5 %, and the law must depend on every quantity on which an acceleration depends.
    """
    error_within: float | None = None
    """Median error of the predicted motion, relative to the distance moved.

    The median is over random initial states and loads within the limits of the laboratory; null if the law has no
    finite solution.
    """
    error_beyond: float | None = None
    """Like `error_within`, for positions outside the laboratory's region, larger speeds and loads, and later times."""
    dependence_f1: float = 0.0
    """F1 score of the pairs of an acceleration and a quantity on which it depends; see `evaluator.answers.laws`."""
    length: int = 0
    """Complexity of the law: its number of names, numbers, operators and functions."""
    refused: str = ""
    """Why the law cannot be parsed or compared; empty for other laws.

    The laboratory refuses laws that cannot be parsed, so such a law is from an edited record or an older version. A law
    cannot be compared if that would take too many operations (see `evaluator.answers.laws.MAX_WORK`).
    """


class GradeRecord(Record):
    """A line of `grades.jsonl`."""

    format: Literal[1] = FORMAT
    key: EpisodeKey
    grade: Grade
    answer_key: JsonValue
    grader_version: str
    pack_version: str
    law: LawGrade | None = Field(default=None, exclude_if=is_absent)
    """Grade of the law that was stated with the answer; absent if the agent stated none, or the scene asks for none."""
