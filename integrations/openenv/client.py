"""The client that a trainer uses: typed actions and observations over the wire."""

from typing import Any

from physment_openenv.models import PhysmentAction, PhysmentObservation, PhysmentState

from openenv.core import EnvClient
from openenv.core.client_types import StepResult


class PhysmentEnv(EnvClient[PhysmentAction, PhysmentObservation, PhysmentState]):
    """An episode on a server.

    `PhysmentEnv(base_url=…).sync()` for code without an event loop.
    """

    def _step_payload(self, action: PhysmentAction) -> dict[str, Any]:
        return {"tool": action.tool, "arguments": action.arguments}

    def _parse_result(self, payload: dict[str, Any]) -> StepResult[PhysmentObservation]:
        reward, done = payload.get("reward"), payload.get("done", False)
        observation = PhysmentObservation(**payload.get("observation", {}) | {"reward": reward, "done": done})
        return StepResult(observation=observation, reward=reward, done=done)

    def _parse_state(self, payload: dict[str, Any]) -> PhysmentState:
        return PhysmentState(**payload)
