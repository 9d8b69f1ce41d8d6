"""Episodes as resource sessions of OpenEnv: the trainer samples each turn, and a harness makes its calls.

TRL's `AsyncGRPOTrainer` plays such sessions, with `MCPHarnessAdapter` as the harness.
"""

import contextlib
from collections.abc import Mapping
from typing import Any

from physment_laboratory import Laboratory
from physment_referee import ANSWER, OpenedEpisode, Referee, RefereeError

from openenv.core.env_server.mcp_types import Tool
from openenv.core.harness import Message, ResourceSession, ResourceSessionFactory, ToolResult, VerifyResult

PATIENCE_S = 600.0
"""Longest time to wait until the referee can open another episode [s]."""


class PhysmentSession(ResourceSession):
    """An open episode. Each turn of the harness is an iteration, so `max_turns` must equal the budget of iterations."""

    def __init__(self, referee: Referee, opened: OpenedEpisode) -> None:
        """Store the episode; the first call connects."""
        self._referee, self._opened = referee, opened
        self._laboratory = Laboratory(opened.mcp_url, opened.player_token)
        self._verified: VerifyResult | None = None

    def initial_messages(self) -> list[Message]:
        """The laboratory's prompt."""
        return [{"role": "user", "content": self._opened.prompt}]

    def list_tools(self) -> list[Tool]:
        """The 26 tools."""
        return [Tool(**tool) for tool in self._opened.tools]

    def call_tool(self, name: str, arguments: dict[str, Any]) -> ToolResult:
        """Make a call. An accepted answer ends the rollout.

        Raises:
            LaboratoryError: The host failed; the agent is not at fault.
        """
        called = self._laboratory.call(name, arguments)
        ended = name == ANSWER and not called.is_error
        return ToolResult(data=called.text, done=ended, error=called.text if called.is_error else None)

    def verify(self, transcript: list[Message], final_state: Any | None = None) -> VerifyResult:
        """Request the reward; an episode without an answer ends here.

        Raises:
            RefereeError: The referee lost the episode, or cannot be reached.
        """
        del final_state
        if self._verified is None:
            turns = sum(message["role"] == "assistant" for message in transcript)
            found = self._referee.reward(
                self._opened.episode_id, self._opened.owner_token, iterations=turns, end="budget_exhausted"
            )
            facts = {"strict": found.strict, "graded": found.graded, "outcome": found.outcome, "calls": found.calls}
            self._verified = VerifyResult(env_reward=found.reward, done=True, metrics=facts)
        return self._verified

    def close(self) -> None:
        """Close the connection. If no reward was requested, close the episode, too."""
        self._laboratory.close()
        if self._verified is None:
            with contextlib.suppress(RefereeError):  # the referee may have closed it already
                self._referee.close(self._opened.episode_id, self._opened.owner_token)


class PhysmentSessionFactory(ResourceSessionFactory[PhysmentSession]):
    """Opens episodes at the referee that `PHYSMENT_REFEREE_URL` names."""

    def __init__(self, **wanted: Any) -> None:
        """Store the defaults of the episodes; `create` opens them.

        Args:
            wanted: Arguments of `Referee.open` for each episode: a `split`, a `world` or a `curriculum`, from which the
                seed of a group selects the variant, and `budget` and `prompting`.
        """
        self._wanted = wanted

    def create(self, task: Any, seed: int | None = None, episode_id: str | None = None) -> PhysmentSession:
        """Open the variant that a task names, or else the one that a seed selects; equal seeds select the same variant.

        Args:
            task: `{"scene": 7, "seed": 3}`, for example. A value that is no mapping, such as the prompt of a row, is
                ignored.
            seed: Seed of the random selection; TRL passes the number of the group.
            episode_id: Not used; the referee assigns the id.

        Raises:
            RefereeError: The referee refused, cannot be reached, or stayed at its limit for ten minutes.
        """
        del episode_id
        variant = dict(task) if isinstance(task, Mapping) else {"random_seed": seed}
        referee = Referee.from_environment()
        return PhysmentSession(referee, referee.open_when_free(PATIENCE_S, **self._wanted | variant))
