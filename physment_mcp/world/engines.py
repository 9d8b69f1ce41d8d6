"""Compatibility with MuJoCo versions from 3.3.3 on, by feature detection.

The rest of the package uses only features that all these versions have.
"""

import mujoco

# Version 3.3.6 replaced the one switch of passive forces by two: passive forces act unless both are set.
_NO_PASSIVE_FORCES = sum(
    int(bit)
    for name, bit in mujoco.mjtDisableBit.__members__.items()
    if name in {"mjDSBL_PASSIVE", "mjDSBL_SPRING", "mjDSBL_DAMPER"}
)


def delete(spec: mujoco.MjSpec, element: mujoco.MjsBody | mujoco.MjsKey) -> None:
    """Delete an element of a spec. A body is deleted with its subtree and all constraints that refer to it."""
    # From version 3.3.4 on, specs delete elements. Earlier ones detach bodies, and other elements delete themselves.
    if hasattr(spec, "delete"):
        spec.delete(element)
    elif isinstance(element, mujoco.MjsBody):
        spec.detach_body(element)
    else:
        element.delete()


def passive_forces_act(model: mujoco.MjModel) -> bool:
    """Whether the engine computes passive forces, and with them the laws of a model.

    Source: MuJoCo `mjtDisableBit`.
    """
    return int(model.opt.disableflags) & _NO_PASSIVE_FORCES != _NO_PASSIVE_FORCES
