"""An episode as an environment of TRL: `reset` opens it, tools are methods, and a method returns the reward.

Public methods of an environment are tools for TRL, so everything else has a leading underscore.
"""

import logging
from types import MethodType
from typing import Any, Protocol

from physment_referee import ANSWER, read_variants

from physment_trl.methods import ANSWER_WITH_LAW, TOOLS, method_of

_LOG = logging.getLogger("physment_trl")

CLOSED = "The episode has ended: your answer was accepted, and no call is run any more. Reply without a call."
"""Result of every tool after an accepted answer. TRL continues to generate until a reply contains no call."""


_ANSWER_WITH_LAW = method_of(ANSWER_WITH_LAW)


class EpisodeLost(Exception):
    """The episode failed for a technical reason, and not by a fault of the agent."""


class OpenEpisode(Protocol):
    """Interface of an open episode: call tools, get the reward, close."""

    prompt: str

    def call(self, tool: str, arguments: dict[str, Any]) -> tuple[str, bool]:
        """Call a tool; returns the text for the model, and whether the call was run rather than refused.

        Raises:
            EpisodeLost: The episode failed.
        """
        ...

    def reward(self, calls: int) -> float:
        """Return the reward, once; an episode without an answer ends as budget exhausted.

        Raises:
            EpisodeLost: The episode failed.
        """
        ...

    def close(self) -> None:
        """Close the episode without a reward."""
        ...


class LaboratoryEnvironment:
    """One rollout at a time. TRL reuses an environment: each `reset` opens another episode.

    Subclasses open episodes. The 26 tools of the laboratory are methods of this class. A refused call returns the
    reason as text, as in `physment-eval`.
    """

    def __init__(self, law: bool = False) -> None:
        """Create the environment without an episode.

        Args:
            law: For open worlds and generated worlds: `answer` has the argument `law`. Other scenes refuse it.
        """
        if law:
            self.answer = MethodType(_ANSWER_WITH_LAW, self)
        self._episode: OpenEpisode | None = None
        self._calls = 0
        self._answered = False
        self._reward: float | None = None

    def reset(
        self,
        scene: int | None = None,
        seed: int | None = None,
        world: dict[str, Any] | None = None,
        split: str | None = None,
        index: int | None = None,
        random_seed: int | None = None,
        curriculum: str | None = None,
        budget: int | None = 20,
        max_calls: int | None = 10000,
        prompting: str | None = "zero-shot",
        **_row: Any,
    ) -> str:
        """Open the episode that a row of the dataset names. A column that is None stands for its default.

        Args:
            scene: Id of the scene.
            seed: Variant of the scene.
            world: Selects worlds instead of a scene, such as `{"level": 5}`.
            split: Name of a split, such as `train`, from which the variant is taken.
            index: Index in the split.
            random_seed: Selects an index in the split at random.
            curriculum: Name of a curriculum on the split or the worlds, which chooses the variant.
            budget: Iterations that the prompt states; `max_tool_calling_iterations` of the trainer must be the same.
            max_calls: Tool calls after which the laboratory ends the episode.
            prompting: `zero-shot`, `one-shot-cot` or `few-shot-cot`.

        Returns:
            The prompt, which TRL appends to the last message of the row.
        """
        self._leave()
        self._calls, self._answered, self._reward = 0, False, None
        named = {"scene": scene, "seed": seed, "split": split, "index": index, "random_seed": random_seed}
        played = {"budget": budget, "max_calls": max_calls, "prompting": prompting}
        # A dataset fills the keys that other rows have with None, in nested columns, too.
        world = {name: value for name, value in (world or {}).items() if value is not None}
        of_worlds = bool(world) or (curriculum is not None and split is None)
        wanted = {**named, "world": world if of_worlds else None, "curriculum": curriculum, **played}
        self._episode = self._open({name: value for name, value in wanted.items() if value is not None})
        return self._episode.prompt

    def get_reward(self) -> float | None:
        """Return the reward of the episode; None, which TRL leaves out of the group, if the episode was lost.

        An answer fixes the reward. An episode without one ends here, as budget exhausted.
        """
        if self._episode is not None:
            self._settle()
        return self._reward

    def _open(self, wanted: dict[str, Any]) -> OpenEpisode:
        raise NotImplementedError

    def _call(self, tool: str, arguments: dict[str, Any]) -> str:
        """Call a tool and return the text for the model.

        Raises:
            EpisodeLost: No episode is open, or it failed. TRL continues, and the rollout has no reward.
        """
        if self._answered:
            return CLOSED
        if self._episode is None:
            raise EpisodeLost("no episode is open: it was lost, or reset was not called")
        try:
            text, ran = self._episode.call(tool, arguments)
        except EpisodeLost as error:
            _LOG.warning("the rollout has no reward: %s", error)
            self._leave()
            raise
        self._calls += 1
        if tool == ANSWER and ran:
            self._answered = True
            self._settle()
        return text

    def _settle(self) -> None:
        """Request the reward and store it; the episode is then closed."""
        episode, self._episode = self._episode, None
        assert episode is not None
        try:
            self._reward = episode.reward(self._calls)
        except EpisodeLost as error:
            _LOG.warning("the rollout has no reward: %s", error)

    def _leave(self) -> None:
        episode, self._episode = self._episode, None
        if episode is not None:
            episode.close()


for _tool in TOOLS:
    setattr(LaboratoryEnvironment, _tool["name"], method_of(_tool))


def rows(**selection: Any) -> list[dict[str, Any]]:
    """Return rows of a dataset for `GRPOTrainer`. Their prompts are empty; `reset` adds the laboratory's prompt.

    Args:
        selection: As for `physment_referee.read_variants`, such as `split="train", random_seeds="1-1000"`.

    Raises:
        ValueError: An argument is malformed; the message is one sentence.
    """
    return [{"prompt": [{"role": "user", "content": ""}], **variant} for variant in read_variants(**selection)]
