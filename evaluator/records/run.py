"""`run.json`: everything that decides the result of a run, as a frozen record. Knows no files."""

from itertools import product
from typing import Literal

from pydantic import ConfigDict, Field, JsonValue

from evaluator.records.episode import FORMAT, EpisodeKey, Record, Versions, is_absent
from scenes import content_hash_of

DECIDING = ("plan", "worlds", "packs", "agents", "forked_from")
"""Fields of `run.json` that two runs must share for their episodes to belong together."""

SEED_SHIFT = 1_000_000
"""Offset added to the seeds of each further repetition of an agent in `Plan.own_seeds`. It is above every seed of a
split, so that a repetition never uses the seeds of another split."""


def _is_text(observations: object) -> bool:
    return observations == "text"


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
    observations: str = Field(default="text", exclude_if=_is_text)
    """`rgb` if results carry pictures; absent for text alone."""
    own_seeds: tuple[str, ...] = Field(default=(), exclude_if=is_absent)
    """Agents that meet a scene with other seeds at each repetition, because they may carry something over: programs
    that play by themselves. Absent if there are none."""
    split: str = Field(default="", exclude_if=is_absent)
    """Name and version of the split that scenes and seeds were taken from, such as `test@1`; absent if none was
    named."""
    held_back: str = Field(default="", exclude_if=is_absent)
    """Commitment to the key of held-back seeds: `seeds` are then numbers of variants, and only the key tells the seeds
    that they were drawn from. Absent if the seeds are as recorded."""

    def matrix(self) -> list[EpisodeKey]:
        """All episodes in playing order, so that a run that is stopped early has whole epochs and budgets."""
        repetitions = product(range(1, self.epochs + 1), self.budgets, self.promptings, self.protocols)
        return [
            EpisodeKey(
                scene=scene,
                seed=seed + (SEED_SHIFT * number if agent in self.own_seeds else 0),
                agent=agent,
                budget=budget,
                prompting=prompting,
                protocol=protocol,
                epoch=epoch,
            )
            for number, (epoch, budget, prompting, protocol) in enumerate(repetitions)
            for agent, seed, scene in product(self.agents, self.seeds, self.scenes)
        ]


class PlayedWorld(OpenRecord):
    """How a world of a run was made."""

    grammar: int
    """Version of the grammar."""
    record: str
    """Hash of its record."""
    split: str
    """Split of its structure."""
    settings: tuple[str, ...] = Field(default=(), exclude_if=is_absent)
    """Attributes that were not those of its level, such as `terms=4`; absent if there were none."""
    commitment: str = Field(default="", exclude_if=is_absent)
    """Commitment to the key that it was drawn with; absent for worlds that everybody can draw."""


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
    shard: str | None = Field(default=None, exclude_if=is_absent)
    resumed: tuple[Start, ...] = Field(default=(), exclude_if=is_absent)


class ForkedRun(OpenRecord):
    """The run whose episodes were continued."""

    folder: str
    """Name of its folder."""
    seal_head: str
    """Head of its seal; empty if it was not sealed."""
    turn: int
    """How many turns of each episode were played again."""


class RunRecord(OpenRecord):
    """`run.json`: everything that decides the result of a run."""

    format: Literal[1] = FORMAT
    created_at: str
    """Time of the first start, in UTC."""
    plan: Plan
    agents: dict[str, dict[str, JsonValue]] = Field(default_factory=dict)
    """Agent → what decides its results besides its name."""
    shard: str | None = Field(default=None, exclude_if=is_absent)
    """Which part of the plan was played here, `i/n`; absent if all of it."""
    server: ServerRecord
    packs: dict[str, str] = Field(default_factory=dict)
    """Scene → hash of its pack."""
    worlds: dict[str, PlayedWorld] = Field(default_factory=dict[str, PlayedWorld], exclude_if=is_absent)
    """Reference → how the world was made; absent if there are none."""
    versions: dict[str, str | None] = Field(default_factory=dict)
    """Python, platform and packages → version, at the first start."""
    git_revision: str | None = None
    resumed: tuple[Start, ...] = Field(default=(), exclude_if=is_absent)
    """The later starts, if the run was interrupted; absent if there was none."""
    merged: tuple[MergedPart, ...] = Field(default=(), exclude_if=is_absent)
    """The runs that this one was made of; absent if it was played."""
    forked_from: ForkedRun | None = Field(default=None, exclude_if=is_absent)
    """The run whose episodes were continued; absent if they were played from their start."""

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
