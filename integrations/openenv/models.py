"""The messages: actions, observations and the state of an episode. None contains a seed, an answer key or a token."""

from typing import Any

from pydantic import Field

from openenv.core.env_server.types import Action, Observation, State


class PhysmentAction(Action):
    """A tool call."""

    tool: str = Field(description="Name of one of the tools that the first observation lists, such as `step`.")
    arguments: dict[str, Any] = Field(default_factory=dict, description="Its arguments, by name.")


class PhysmentObservation(Observation):
    """The result of an action. `done` and `reward` are set in the last one."""

    text: str = Field(default="", description="What the model reads: the result as JSON, or why the call was refused.")
    is_error: bool = Field(default=False, description="Whether the call was refused; then it changed nothing.")
    result: dict[str, Any] | None = Field(default=None, description="The result as data.")
    prompt: str = Field(default="", description="The opening prompt, with the first observation.")
    tools: list[dict[str, Any]] = Field(
        default_factory=list, description="The tools, with the first observation: name, description, input_schema."
    )
    iterations_left: int = Field(default=0, description="Actions that are left.")
    outcome: str = Field(default="", description="How the episode ended: answered or budget_exhausted.")
    verdict: dict[str, Any] = Field(default_factory=dict, description="strict, normalised, graded: after the end.")


class PhysmentState(State):
    """The state of an episode."""

    scene: int | None = None
    world: str | None = None
    split: str | None = None
    index: int | None = None
    budget: int = 0
    done: bool = False
