"""PhysMent's laboratory for OpenEnv: an action is a tool call, the reward comes with the last observation."""

from importlib.metadata import version

_TESTED = "0.10"

if version("openenv").split(".")[:2] != _TESTED.split("."):
    raise ImportError(
        f"physment-openenv is tested with openenv {_TESTED} and not with {version('openenv')}:"
        f" pip install 'openenv=={_TESTED}.*'"
    )

from physment_openenv.client import PhysmentEnv  # noqa: E402 - it needs the version that is checked above
from physment_openenv.models import PhysmentAction, PhysmentObservation, PhysmentState  # noqa: E402 - as above

__all__ = ["PhysmentAction", "PhysmentEnv", "PhysmentObservation", "PhysmentState"]
