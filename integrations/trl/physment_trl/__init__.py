"""PhysMent's laboratory for TRL: environment classes for `GRPOTrainer(environment_factory=...)`.

`PhysMent` plays on a host and is graded by a referee. `physment_trl.in_process.InProcessPhysMent` plays and grades in
the process of the trainer.
"""

from importlib.metadata import version

_TESTED = "1.16"

if version("trl").split(".")[:2] != _TESTED.split("."):
    raise ImportError(
        f"physment-trl is tested with trl {_TESTED} and not with {version('trl')}: pip install 'trl=={_TESTED}.*'"
    )

from physment_trl.environment import LaboratoryEnvironment, rows  # noqa: E402 - it needs the version that is checked above
from physment_trl.referee import PhysMent  # noqa: E402 - as above

__all__ = ["LaboratoryEnvironment", "PhysMent", "rows"]
