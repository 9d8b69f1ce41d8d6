"""What a trainer sends to a referee, and what it gets. Knows no HTTP and no keys."""

from dataclasses import dataclass
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from evaluator.answers.rewards import AnswerReward
from evaluator.episode.player import Briefing
from evaluator.records.episode import Grade, Outcome

MOST_CALLS = 10_000
"""Most tool calls of an episode; a host accepts no higher limit."""

LARGEST = 2**64 - 1
"""Largest magnitude of a whole number in a request, such as a random seed of 64 bits."""
MOST_ITERATIONS = 1_000_000
"""Most iterations that a trainer can report; each may cost a part of the reward, which is a float."""


class WantedWorld(BaseModel):
    """Which worlds are meant: those of a level, or those that have so many parts. Absent fields leave it open."""

    model_config = ConfigDict(extra="forbid", strict=True)

    level: int | None = Field(default=None, ge=1, le=10)
    terms: int | None = Field(default=None, ge=1, le=6)
    """Terms of its law."""
    modulations: int | None = Field(default=None, ge=0, le=6)
    hidden: int | None = Field(default=None, ge=0, le=3)
    """Hidden bodies."""
    apparatus: Literal["puck", "pair", "wheel", "glider"] | None = None


class WantedEpisode(BaseModel):
    """Body of `POST /episodes`: which variant, and how it is played. `variants` says what names a variant."""

    model_config = ConfigDict(extra="forbid", strict=True)

    scene: int | None = Field(default=None, ge=0, le=LARGEST)
    seed: int | None = Field(default=None, ge=0, le=LARGEST)
    world: WantedWorld | None = None
    """Which worlds are meant, in the place of a scene; `index` and `random_seed` then choose among them."""
    split: str | None = Field(default=None, max_length=100)
    """Name of a split, with or without its version, such as `train` or `train@1`."""
    index: int | None = Field(default=None, ge=0, le=LARGEST)
    """Place in the split."""
    random_seed: int | None = Field(default=None, ge=-LARGEST, le=LARGEST)
    """Draws a place in the split."""
    budget: int = Field(default=20, ge=1, le=1000)
    """Iterations that the opening prompt names. Whoever asks the model counts them."""
    max_calls: int = Field(default=MOST_CALLS, ge=1, le=MOST_CALLS)
    """Tool calls after which the laboratory ends the episode."""
    prompting: Literal["zero-shot", "one-shot-cot", "few-shot-cot"] = "zero-shot"


class EndedEpisode(BaseModel):
    """Body of `POST /episodes/ID/reward`."""

    model_config = ConfigDict(extra="forbid", strict=True)

    iterations: int | None = Field(default=None, ge=0, le=MOST_ITERATIONS)
    """Replies of the agent; None counts each call as one."""
    end: Literal["budget_exhausted", "agent_error"] | None = None
    """Ends an episode without an answer, and says why; None only asks."""


@dataclass(frozen=True, slots=True)
class Variant:
    """A variant of a scene, and its place in the split that it was taken from."""

    scene: int
    seed: int
    """As recorded: the number of the variant if its seed is held back."""
    split: str = ""
    """Name and version of the split, such as `train@1`; empty if none was named."""
    index: int | None = None
    """Its place in the split; None without one."""


@dataclass(frozen=True, slots=True)
class OpenedEpisode:
    """What a trainer gets."""

    variant: Variant
    episode_id: str
    owner_token: str
    """Asks for the reward, and closes the episode. Never for the agent."""
    mcp_url: str
    player_token: str | None
    """What every request of the agent's client must carry."""
    briefing: Briefing


@dataclass(frozen=True, slots=True)
class Reward:
    """What an episode was worth. Holds no key, and no reason, since a reason may state the key."""

    reward: float
    answer: AnswerReward
    cost: float
    """What was taken off for iterations and calls."""
    grade: Grade
    outcome: Outcome
    calls: int
