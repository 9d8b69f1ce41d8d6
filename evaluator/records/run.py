"""`run.json` as a frozen record: everything that determines the result of a run. Contains no file access.

A keyed hash derives held-back seeds, which are unknown without the key. Records hold the number of a variant (0, 1, …)
in place of its seed, and a commitment to the key. The seed is derived from the number and the key only where a session
is opened and where an answer key is computed.
"""

import hashlib
import hmac
import re
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import product
from typing import Literal

from pydantic import ConfigDict, Field, JsonValue

from evaluator.records.episode import FORMAT, EpisodeKey, Record, Versions, is_absent
from scenes import content_hash_of

SeedOf = Callable[[int, int], int]
"""Function of a scene id and a recorded seed that returns the real seed of the variant."""

_DIGITS = 64
_PURPOSE = b"physment held-back seeds 1: "
"""Prefix that separates commitment and seeds from other uses of the same key (domain separation)."""


def seed_as_recorded(scene: int, seed: int) -> int:
    """The `SeedOf` of runs whose seeds are not held back: returns the recorded seed."""
    del scene
    return seed


@dataclass(frozen=True, slots=True)
class SeedKey:
    """The secret of a held-back split."""

    secret: bytes = field(repr=False)

    @classmethod
    def parse(cls, text: str) -> "SeedKey":
        """Parse the content of a key file.

        Raises:
            ValueError: The text is not 64 hexadecimal digits. A shorter key could be found by brute force.
        """
        if not re.fullmatch(rf"[0-9a-fA-F]{{{_DIGITS}}}", text.strip()):
            raise ValueError(f"it must hold {_DIGITS} hexadecimal digits and nothing else")
        return cls(bytes.fromhex(text.strip()))

    def seed(self, scene: int, number: int) -> int:
        """Return the seed of a variant, from 1 to 2^63: HMAC-SHA256 of the scene and the number of the variant."""
        digest = hmac.digest(self.secret, _PURPOSE + f"{scene}:{number}".encode(), "sha256")
        return (int.from_bytes(digest[:8], "big") >> 1) + 1

    @property
    def commitment(self) -> str:
        """Return a commitment to the key that does not disclose it: SHA-256 of a fixed prefix and the key.

        Equal keys give equal commitments, so runs on the same held-back seeds can be recognised as comparable. No salt
        is needed, because a key of 256 random bits cannot be found by brute force.
        """
        return hashlib.sha256(_PURPOSE + self.secret).hexdigest()


DECIDING = ("plan", "worlds", "packs", "agents", "forked_from")
"""Fields of `run.json` that must be equal in two runs whose episodes are combined."""

SEED_SHIFT = 1_000_000
"""Offset added to the seeds of each further repetition of an agent in `Plan.own_seeds`. It is larger than every seed of
a split, so a repetition never uses the seeds of another split."""


def _is_text(observations: object) -> bool:
    return observations == "text"


class OpenRecord(Record):
    """A record that other versions of this program may extend: unknown fields are kept."""

    model_config = ConfigDict(extra="allow")


class AdaptivePlan(OpenRecord):
    """The stopping rule of an adaptive test, and the calibration by which it chooses scenes."""

    se: float
    """Standard error of the ability at which the test of an agent ends [logits]."""
    difficulties_sha256: str
    """SHA-256 of the calibration with the difficulties."""


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
    """`rgb` if results carry images; absent for text only."""
    own_seeds: tuple[str, ...] = Field(default=(), exclude_if=is_absent)
    """External programs, which get other seeds at each repetition because they may remember earlier episodes. Absent if
    there are none."""
    split: str = Field(default="", exclude_if=is_absent)
    """Name and version of the split of scenes and seeds, such as `test@1`; absent if none was named."""
    held_back: str = Field(default="", exclude_if=is_absent)
    """Commitment to the key of held-back seeds. `seeds` are then numbers of variants, from which only the key derives
    the real seeds. Absent if `seeds` are the real seeds."""
    presentation: tuple[str, ...] = Field(default=(), exclude_if=is_absent)
    """Changes of the presentation that agents received, such as `names`; absent if there were none.

    Records always hold the laboratory's own terms.
    """
    replaced: dict[str, dict[int, int]] = Field(default_factory=dict[str, dict[int, int]], exclude_if=is_absent)
    """Scene → seed that failed its checks → seed that is played instead; absent if none was replaced."""
    adaptive: AdaptivePlan | None = Field(default=None, exclude_if=is_absent)
    """Set if an adaptive test chose which episodes of the matrix to play; absent if all are played."""

    def matrix(self) -> list[EpisodeKey]:
        """Return all episodes in playing order.

        Epochs are played one after the other, and the budgets of an epoch too, so a run that is stopped early has
        complete epochs and budgets.
        """
        repetitions = product(range(1, self.epochs + 1), self.budgets, self.promptings, self.protocols)
        return [
            EpisodeKey(
                scene=scene,
                seed=self._played(scene, seed + (SEED_SHIFT * number if agent in self.own_seeds else 0)),
                agent=agent,
                budget=budget,
                prompting=prompting,
                protocol=protocol,
                epoch=epoch,
            )
            for number, (epoch, budget, prompting, protocol) in enumerate(repetitions)
            for agent, seed, scene in product(self.agents, self.seeds, self.scenes)
        ]

    def _played(self, scene: int, seed: int) -> int:
        return self.replaced.get(str(scene), {}).get(seed, seed)


class SeedProofs(OpenRecord):
    """Results of the checks of seeds that no certificate covers.

    Generated worlds are omitted, because the result of their checks does not depend on the seed.
    """

    proved: dict[str, tuple[int, ...]] = Field(default_factory=dict[str, tuple[int, ...]], exclude_if=is_absent)
    """Scene → seeds that passed the checks before they were played; absent if there are none."""
    unproved: dict[str, tuple[int, ...]] = Field(default_factory=dict[str, tuple[int, ...]], exclude_if=is_absent)
    """Scene → seeds that were played unchecked, because the operator disabled the checks or the scene has no
    certificate.
    """
    left_out: dict[str, dict[int, str]] = Field(default_factory=dict[str, dict[int, str]], exclude_if=is_absent)
    """Scene → seed that was not played → names of the certificates that it fails; absent if there are none."""


class PlayedWorld(OpenRecord):
    """Provenance of a generated world."""

    grammar: int
    """Version of the grammar."""
    record: str
    """Hash of the world's record."""
    split: str
    """Split that the world's structure belongs to."""
    settings: tuple[str, ...] = Field(default=(), exclude_if=is_absent)
    """Attributes that differ from those of the world's level, such as `terms=4`; absent if there are none."""
    commitment: str = Field(default="", exclude_if=is_absent)
    """Commitment to the key from which the world was drawn; absent for worlds that anyone can draw."""


class ServerRecord(OpenRecord):
    """The server of a run."""

    option: str
    """Value of `--server`."""
    name: str | None = None
    version: str | None = None
    protocol: str = ""
    """Negotiated version of MCP."""
    tools: int = 0
    """Number of tools."""
    tool_schema_hash: str = ""


class Start(OpenRecord):
    """One start of the program: time, server and software."""

    created_at: str
    server: ServerRecord
    versions: dict[str, str | None] = Field(default_factory=dict)
    """Python, platform and packages → version; null for a package that is not installed."""
    git_revision: str | None = None
    """Git revision of the checkout; null for an installed package."""


class MergedPart(Start):
    """One of the run folders that were merged."""

    folder: str
    """Name of the folder."""
    shard: str | None = Field(default=None, exclude_if=is_absent)
    resumed: tuple[Start, ...] = Field(default=(), exclude_if=is_absent)


class ForkedRun(OpenRecord):
    """The run whose episodes were continued."""

    folder: str
    """Name of the run's folder."""
    seal_head: str
    """Head of the run's hash chain (`seal.json`); empty without one."""
    turn: int
    """Number of turns of each episode that were replayed."""


class RunRecord(OpenRecord):
    """`run.json`: everything that determines the result of a run."""

    format: Literal[1] = FORMAT
    created_at: str
    """Time of the first start, in UTC."""
    plan: Plan
    agents: dict[str, dict[str, JsonValue]] = Field(default_factory=dict)
    """Agent → settings besides its name that determine its results."""
    shard: str | None = Field(default=None, exclude_if=is_absent)
    """The part of the plan that was played here, as `i/n`; absent if it was the whole plan."""
    server: ServerRecord
    packs: dict[str, str] = Field(default_factory=dict)
    """Scene → hash of its pack."""
    worlds: dict[str, PlayedWorld] = Field(default_factory=dict[str, PlayedWorld], exclude_if=is_absent)
    """Reference of a world → its provenance; absent if there are no worlds."""
    seed_proofs: SeedProofs | None = Field(default=None, exclude_if=is_absent)
    """Results of the checks of seeds that no certificate covers; absent in records of older versions without checks."""
    versions: dict[str, str | None] = Field(default_factory=dict)
    """Python, platform and packages → version, at the first start."""
    git_revision: str | None = None
    resumed: tuple[Start, ...] = Field(default=(), exclude_if=is_absent)
    """The later starts of an interrupted run; absent if there are none."""
    merged: tuple[MergedPart, ...] = Field(default=(), exclude_if=is_absent)
    """The runs that were merged into this one; absent for a run that was played."""
    forked_from: ForkedRun | None = Field(default=None, exclude_if=is_absent)
    """The run whose episodes were continued; absent if they were played from their start."""

    def start(self) -> Start:
        """Return the first start."""
        return Start(
            created_at=self.created_at, server=self.server, versions=self.versions, git_revision=self.git_revision
        )

    def tool_contracts(self) -> frozenset[str]:
        """Return the hashes of the tool schemas at each start, of this run and of the runs merged into it."""
        starts = [self.start(), *self.resumed, *self.merged]
        starts += [start for part in self.merged for start in part.resumed]
        return frozenset(start.server.tool_schema_hash for start in starts) - {""}

    def content_hashes(self) -> dict[str, str]:
        """Return the content hash of each scene's pack; hashes of bytes in older records are converted."""
        return {scene: content_hash_of(stored) for scene, stored in self.packs.items()}

    def difference(self, other: "RunRecord") -> str:
        """Return the first of the `DECIDING` fields that differs between two runs; empty if none differs."""
        mine, theirs = (run.model_copy(update={"packs": run.content_hashes()}) for run in (self, other))
        return next((name for name in DECIDING if getattr(mine, name) != getattr(theirs, name)), "")

    def versions_of(self, scene: int) -> Versions:
        """Return the versions that are recorded with an episode of a scene."""
        return Versions(
            physment=self.versions["physment-mcp"] or "",
            protocol=self.server.protocol,
            pack=self.packs[str(scene)],
        )


class RunningEpisode(Record):
    """The state of an episode that is being played, as progress displays show it."""

    key: EpisodeKey
    turn: int
    """Number of its present turn, from 1; 0 if it is not known."""
    call: str
    """Name of the last tool that was called; empty if it is not known."""
    began_at: str
    """Time of its beginning, ISO 8601 in UTC."""


class RunningEpisodes(Record):
    """The file `running.json`, which exists only while a run is played."""

    episodes: tuple[RunningEpisode, ...]
