"""What a run leaves on disk, as frozen records with a format number. Knows no files and no rules of grading."""

from collections.abc import Iterable
from enum import StrEnum
from itertools import product
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, JsonValue

from scenes import content_hash_of

FORMAT = 1
"""Version of the format on disk. Readers refuse a higher version."""
DECIDING = ("plan", "packs", "agents")
"""Fields of `run.json` that two runs must share for their episodes to belong together."""


class Record(BaseModel):
    """Base of all records: frozen, no unknown fields, only finite numbers."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, use_attribute_docstrings=True)


def _is_absent(value: object) -> bool:
    """Whether a field is left out of the file."""
    return not value


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
    steps: dict[str, bool] | None = Field(default=None, exclude_if=_is_absent)
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


class OpenRecord(Record):
    """A record that other versions of this program may extend: fields that this version does not know are kept."""

    model_config = ConfigDict(extra="allow")


class Plan(OpenRecord):
    """The matrix of a run: each combination of these values is an episode."""

    scenes: tuple[int, ...]
    agents: tuple[str, ...]
    """Names of the agents."""
    budgets: tuple[int, ...] = (20,)
    seeds: tuple[int, ...] = (0,)
    epochs: int = 1
    promptings: tuple[str, ...] = ("zero-shot",)
    protocols: tuple[str, ...] = ("native",)

    def matrix(self) -> list[EpisodeKey]:
        """All episodes in playing order, so that a run that is stopped early has whole epochs and budgets."""
        epochs = range(1, self.epochs + 1)
        prompts = product(self.budgets, self.promptings, self.protocols)
        return [
            EpisodeKey(
                scene=scene, seed=seed, agent=agent, budget=budget, prompting=prompting, protocol=protocol, epoch=epoch
            )
            for epoch, (budget, prompting, protocol), agent, seed, scene in product(
                epochs, prompts, self.agents, self.seeds, self.scenes
            )
        ]


class ServerRecord(OpenRecord):
    """The server that a run was played on."""

    option: str
    """Value of `--server`."""
    name: str | None = None
    version: str | None = None
    protocol: str = ""
    """Version of MCP that was negotiated."""
    tools: int = 0
    """Number of its tools."""
    tool_schema_hash: str = ""


class Start(OpenRecord):
    """A start of the program: when, on which server, with which software."""

    created_at: str
    server: ServerRecord
    versions: dict[str, str | None] = Field(default_factory=dict)
    """Python, platform and packages → version; null where a package is not installed."""
    git_revision: str | None = None
    """Revision of the checkout; null for an installed package."""


class MergedPart(Start):
    """One of the run folders that a merged run was made of."""

    folder: str
    """Name of the folder."""
    shard: str | None = Field(default=None, exclude_if=_is_absent)
    resumed: tuple[Start, ...] = Field(default=(), exclude_if=_is_absent)


class RunRecord(OpenRecord):
    """`run.json`: everything that decides the result of a run."""

    format: Literal[1] = FORMAT
    created_at: str
    """Time of the first start, in UTC."""
    plan: Plan
    agents: dict[str, dict[str, JsonValue]] = Field(default_factory=dict)
    """Agent → what decides its results besides its name."""
    shard: str | None = Field(default=None, exclude_if=_is_absent)
    """Which part of the plan was played here, `i/n`; absent if all of it."""
    server: ServerRecord
    packs: dict[str, str] = Field(default_factory=dict)
    """Scene → hash of its pack."""
    versions: dict[str, str | None] = Field(default_factory=dict)
    """Python, platform and packages → version, at the first start."""
    git_revision: str | None = None
    resumed: tuple[Start, ...] = Field(default=(), exclude_if=_is_absent)
    """The later starts, if the run was interrupted; absent if there was none."""
    merged: tuple[MergedPart, ...] = Field(default=(), exclude_if=_is_absent)
    """The runs that this one was made of; absent if it was played."""

    def start(self) -> Start:
        """The first start."""
        return Start(
            created_at=self.created_at, server=self.server, versions=self.versions, git_revision=self.git_revision
        )

    def tool_contracts(self) -> frozenset[str]:
        """Hashes of the tool schemas at each start, of this run and of those that it was made of."""
        starts = [self.start(), *self.resumed, *self.merged]
        starts += [start for part in self.merged for start in part.resumed]
        return frozenset(start.server.tool_schema_hash for start in starts) - {""}

    def content_hashes(self) -> dict[str, str]:
        """Scene → hash of its pack's content, also if the run was recorded with hashes of bytes."""
        return {scene: content_hash_of(stored) for scene, stored in self.packs.items()}

    def difference(self, other: "RunRecord") -> str:
        """The first of the `DECIDING` fields in which another run differs; empty if the two belong together."""
        mine, theirs = (run.model_copy(update={"packs": run.content_hashes()}) for run in (self, other))
        return next((name for name in DECIDING if getattr(mine, name) != getattr(theirs, name)), "")

    def versions_of(self, scene: int) -> Versions:
        """What is recorded with an episode of a scene."""
        return Versions(
            physment=self.versions["physment-mcp"] or "",
            protocol=self.server.protocol,
            pack=self.packs[str(scene)],
        )
