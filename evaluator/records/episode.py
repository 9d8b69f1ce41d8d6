"""Episodes, grades and evidence, as frozen records with a format number. Knows no files and no rules of grading."""

import hashlib
from collections.abc import Iterable
from enum import StrEnum
from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, JsonValue

FORMAT = 1
"""Version of the format on disk. Readers refuse a higher version."""
SUFFICIENT = 0.5
"""Largest bound of an answer, in tolerances, up to which its evidence suffices."""
CERTAIN = 0.95
"""Least probability of the right choice from which on the evidence for a choice suffices."""


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
    """Ended by an infrastructure error, or played on a pack that is withdrawn: counted apart, never wrong."""


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


class CallEvidence(Record):
    """What is known after a call."""

    turn: int
    """Number of the turn, from 1."""
    call: int
    """Number of the call in the episode, from 1."""
    bounds: tuple[float, ...]
    """For each asked number, its smallest standard error over its tolerance. Source: Cramér and Rao."""
    choice: float | None = None
    """Probability of the right choice, by constants that the readings leave plausible; null if no choice is asked."""
    rivals: int = 0
    """How many other discrete values, with another answer, the readings leave possible."""
    bits: float
    """Information on the hidden constants, over what their ranges tell [bit]."""

    @property
    def suffices(self) -> bool:
        """Whether the constants are known well enough, and other discrete values are excluded."""
        known = max(self.bounds, default=0.0) <= SUFFICIENT and (self.choice is None or self.choice >= CERTAIN)
        return known and not self.rivals


class Rival(Record):
    """Another structure, or another value of a discrete constant, that gives another answer."""

    name: str
    chi_square: float
    """By how much it fits all readings worse than the drawn one."""
    excluded: bool
    """Whether the readings exclude it at four standard deviations."""


class EvidenceRecord(Record):
    """A line of `evidence.jsonl`: what the experiments of one episode could tell."""

    format: Literal[1] = 1
    key: EpisodeKey
    episode: str
    """SHA-256 of the line of the episode in `episodes.jsonl`."""
    calls: tuple[CallEvidence, ...] = ()
    """After each call that read something new."""
    rivals: tuple[Rival, ...] = ()
    """The rivals after the last call."""
    not_measurable: str = ""
    """Why the evidence cannot be computed; empty if it can."""
    seconds: float = Field(default=0.0, ge=0)
    """Processor time that it took [s]."""

    @property
    def suffices(self) -> bool:
        """Whether the readings decide the answer in the end."""
        return bool(self.calls) and self.calls[-1].suffices and all(rival.excluded for rival in self.rivals)

    @property
    def sufficed_at(self) -> int | None:
        """The call from which on the evidence sufficed; None if it never did.

        Structures that the pack fits count in the end alone, because they are fitted to all readings.
        """
        return next((step.call for step in self.calls if step.suffices), None) if self.suffices else None


class EvidenceVerdict(StrEnum):
    """What an episode shows: were its experiments at fault, or its reasoning?"""

    EARNED = "earned"
    """Right, and the readings decide the answer."""
    GUESSED = "guessed right without evidence"
    """Right, although the readings leave the answer open."""
    INFERENCE_FAILED = "inference failed on sufficient evidence"
    """Wrong or without an answer, although the readings decide it."""
    EXPERIMENT_INSUFFICIENT = "experiment insufficient"
    """Wrong or without an answer, and the readings leave it open."""


def evidence_verdict(evidence: EvidenceRecord, verdict: Verdict) -> EvidenceVerdict | None:
    """The verdict on the evidence of an episode; None if it cannot be measured, or if the episode has no verdict."""
    if evidence.not_measurable or verdict is Verdict.UNSCORED:
        return None
    if verdict is Verdict.CORRECT:
        return EvidenceVerdict.EARNED if evidence.suffices else EvidenceVerdict.GUESSED
    return EvidenceVerdict.INFERENCE_FAILED if evidence.suffices else EvidenceVerdict.EXPERIMENT_INSUFFICIENT
