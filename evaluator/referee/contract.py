"""Messages between trainers and a referee: requests and responses. The module handles no answer keys."""

from dataclasses import dataclass
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from evaluator.answers.rewards import AnswerReward
from evaluator.episode.player import Briefing
from evaluator.records.episode import Grade, Outcome

MOST_CALLS = 10_000
"""Largest number of tool calls in an episode; an episode server accepts no higher limit."""

LARGEST = 2**64 - 1
"""Largest magnitude of an integer in a request, so that 64-bit random seeds are accepted."""
MOST_IN_GROUP = 64
"""Largest number of episodes that one request opens."""
MOST_ITERATIONS = 1_000_000
"""Largest number of iterations that a trainer can report, which keeps the deducted cost a finite float."""


class WantedWorld(BaseModel):
    """Selects worlds by level or by their parts. A field that is None matches every world."""

    model_config = ConfigDict(extra="forbid", strict=True)

    level: int | None = Field(default=None, ge=1, le=10)
    terms: int | None = Field(default=None, ge=1, le=6)
    """Number of terms of the law."""
    modulations: int | None = Field(default=None, ge=0, le=6)
    hidden: int | None = Field(default=None, ge=0, le=3)
    """Number of hidden bodies."""
    apparatus: Literal["puck", "pair", "wheel", "glider"] | None = None


class WantedEpisode(BaseModel):
    """Body of `POST /episodes`: the variant and how it is played.

    `selection.variant_of` lists the ways to name a variant.
    """

    model_config = ConfigDict(extra="forbid", strict=True)

    scene: int | None = Field(default=None, ge=0, le=LARGEST)
    seed: int | None = Field(default=None, ge=0, le=LARGEST)
    world: WantedWorld | None = None
    """Selects worlds instead of a scene; `index` or `random_seed` then chooses one of them."""
    split: str | None = Field(default=None, max_length=100)
    """Name of a split, with or without its version, such as `train` or `train@1`."""
    index: int | None = Field(default=None, ge=0, le=LARGEST)
    """Position in the numbering of the split's variants; see `selection.variant_of`."""
    random_seed: int | None = Field(default=None, ge=-LARGEST, le=LARGEST)
    """Random seed that selects a position in the split."""
    budget: int = Field(default=20, ge=1, le=1000)
    """Number of iterations stated in the opening prompt. The trainer counts them."""
    max_calls: int = Field(default=MOST_CALLS, ge=1, le=MOST_CALLS)
    """Number of tool calls after which the server ends the episode."""
    prompting: Literal["zero-shot", "one-shot-cot", "few-shot-cot"] = "zero-shot"


class WantedGroup(WantedEpisode):
    """Body of `POST /episodes` for one episode, or for several of the same variant: the rollouts of one prompt."""

    count: int | None = Field(default=None, ge=1, le=MOST_IN_GROUP)
    """Number of episodes, all of which are opened or none; None for a single episode."""
    curriculum: str | None = Field(default=None, pattern=r"^[A-Za-z0-9_.-]{1,100}$")
    """Name of a curriculum, which then chooses the variant; None for none."""


class WantedVariants(WantedWorld):
    """Query parameters of `GET /variants`: a split, or worlds by level or parts, and the page of the list."""

    # Query parameters are strings.
    model_config = ConfigDict(extra="forbid", strict=False)

    split: str | None = Field(default=None, max_length=100)
    offset: int = Field(default=0, ge=0, le=LARGEST)
    """Number of scenes to leave out at the start."""
    limit: int = Field(default=100, ge=1, le=1000)
    """Largest number of scenes in the reply."""


class EndedEpisode(BaseModel):
    """Body of `POST /episodes/ID/reward`."""

    model_config = ConfigDict(extra="forbid", strict=True)

    iterations: int | None = Field(default=None, ge=0, le=MOST_ITERATIONS)
    """Number of replies of the agent; None to count each call as one."""
    end: Literal["budget_exhausted", "agent_error"] | None = None
    """Reason for ending an episode without an answer; None if the episode has already ended."""


@dataclass(frozen=True, slots=True)
class Variant:
    """A variant of a scene, and its index in the split from which it was chosen."""

    scene: int
    seed: int
    """Seed as recorded; if the seed is held back, the number of the variant."""
    split: str = ""
    """Name and version of the split, such as `train@1`; empty if none was named."""
    index: int | None = None
    """Its position in the split; None without one."""
    step: tuple[str, int, int] | None = None
    """The curriculum that drew the variant, its step of difficulty, and the `place` of its window; None without one."""


@dataclass(frozen=True, slots=True)
class OpenedEpisode:
    """An opened episode, as the trainer receives it."""

    variant: Variant
    episode_id: str
    owner_token: str
    """Bearer token for requesting the reward and closing the episode. The agent must not receive it."""
    mcp_url: str
    player_token: str | None
    """Bearer token that every request of the agent's client must carry."""
    briefing: Briefing


@dataclass(frozen=True, slots=True)
class Reward:
    """Reward of an episode. It contains no answer key and no reason, because a reason may state the key."""

    reward: float
    answer: AnswerReward
    cost: float
    """Amount that was subtracted for iterations and calls."""
    grade: Grade
    outcome: Outcome
    calls: int
    shaping: list[float] | None = None
    """Shaping reward of each call; None if the referee computes none or they are not measurable."""
