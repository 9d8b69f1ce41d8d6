"""An episode as an OpenEnv environment: `reset` opens it, `step` makes a call, the last step returns the reward."""

import contextlib
from typing import Any

from physment_laboratory import Laboratory
from physment_openenv.models import PhysmentAction, PhysmentObservation, PhysmentState
from physment_referee import ANSWER, OpenedEpisode, Referee, RefereeError

from openenv.core.env_server.interfaces import Environment
from openenv.core.env_server.types import EnvironmentMetadata

_FIRST_SCENE = 7
"""The scene that is opened if neither a scene nor a split is named."""


class PhysmentEnvironment(Environment[PhysmentAction, PhysmentObservation, PhysmentState]):
    """One session, which plays one episode at a time. An action is an iteration with one call."""

    SUPPORTS_CONCURRENT_SESSIONS = True

    def __init__(self) -> None:
        """Create the environment without an episode."""
        super().__init__()
        self._referee = Referee.from_environment()
        self._state = PhysmentState(episode_id=None, step_count=0)
        self._opened: OpenedEpisode | None = None
        self._laboratory: Laboratory | None = None

    def reset(
        self,
        seed: int | None = None,
        episode_id: str | None = None,
        scene: int | None = None,
        budget: int = 20,
        prompting: str = "zero-shot",
        split: str | None = None,
        index: int | None = None,
        random_seed: int | None = None,
        world: dict[str, Any] | None = None,
        curriculum: str | None = None,
        **_options: Any,
    ) -> PhysmentObservation:
        """Open an episode, and close the previous one.

        Args:
            seed: Variant of the scene; without a split, None and 0 mean the scene as written.
            episode_id: Id of the episode; by default the id that the referee assigned.
            scene: Id of the scene.
            budget: Number of actions.
            prompting: `zero-shot`, `one-shot-cot` or `few-shot-cot`.
            split: Name of a split, such as `train`, from which the variant is taken.
            index: Index in the split.
            random_seed: Selects an index in the split at random.
            world: Selects generated worlds instead of a scene, such as `{"level": 5}`.
            curriculum: Name of a curriculum on the split or the worlds, which chooses the variant.

        Raises:
            RefereeError: The referee refused, or cannot be reached.
        """
        self.close()
        place = {"split": split, "index": index, "random_seed": random_seed, "world": world, "curriculum": curriculum}
        if scene is None and split is None and world is None:
            scene = _FIRST_SCENE
        opened = self._referee.open(scene, seed, budget=budget, prompting=prompting, **place)
        self._opened = opened
        self._laboratory = Laboratory(opened.mcp_url, opened.player_token)
        self._state = PhysmentState(
            episode_id=episode_id or opened.episode_id,
            step_count=0,
            scene=opened.scene,
            world=opened.world,
            split=opened.split,
            index=opened.index,
            budget=opened.budget,
        )
        return PhysmentObservation(
            prompt=opened.prompt, text=opened.prompt, tools=list(opened.tools), iterations_left=opened.budget
        )

    def step(self, action: PhysmentAction, timeout_s: float | None = None, **_options: Any) -> PhysmentObservation:
        """Make a call. An answer ends the episode, and so does the last action of the budget.

        Raises:
            RefereeError: No episode is open, it has ended, or the referee refused.
            LaboratoryError: The host failed; the agent is not at fault.
        """
        del timeout_s
        if self._laboratory is None or self._opened is None:
            raise RefereeError(
                "the episode has ended: reset opens another" if self._state.done else "no episode is open: reset first"
            )
        called = self._laboratory.call(action.tool, action.arguments)
        self._state.step_count += 1
        left = self._state.budget - self._state.step_count
        observation = PhysmentObservation(
            text=called.text, result=called.content, is_error=called.is_error, iterations_left=left
        )
        if left == 0 or (action.tool == ANSWER and not called.is_error):
            self._end(observation)
        return observation

    def _end(self, observation: PhysmentObservation) -> None:
        """Request the reward and add it to the last observation of the episode."""
        assert self._opened is not None
        assert self._laboratory is not None
        self._laboratory.close()
        found = self._referee.reward(
            self._opened.episode_id,
            self._opened.owner_token,
            iterations=self._state.step_count,
            end="budget_exhausted",
        )
        observation.done, observation.reward, observation.outcome = True, found.reward, found.outcome
        observation.verdict = {"strict": found.strict, "normalised": found.normalised, "graded": found.graded}
        self._opened, self._laboratory, self._state.done = None, None, True

    @property
    def state(self) -> PhysmentState:
        """The state of the episode."""
        return self._state

    def get_metadata(self) -> EnvironmentMetadata:
        """Return the name, description and version of the environment."""
        return EnvironmentMetadata(
            name="PhysMent",
            description="A MuJoCo laboratory with 26 tools: find out by experiment what the scene asks, then answer.",
            version="0.2.0",
        )

    def close(self) -> None:
        """Close the connection and the episode. An episode that is closed before its end gets no reward."""
        if self._laboratory is not None:
            self._laboratory.close()
        if self._opened is not None:
            with contextlib.suppress(RefereeError):  # the referee may have closed it already
                self._referee.close(self._opened.episode_id, self._opened.owner_token)
        self._laboratory, self._opened = None, None
