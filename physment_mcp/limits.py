"""How far an agent may go in a laboratory, and how finely it may read: what a scene says, as checks and instruments."""

import math
from collections.abc import Sequence
from typing import Literal

from physment_mcp.errors import BeyondLimit
from physment_mcp.world import Fineness, Readout
from physment_mcp.world.readout import EXACT, Quantity
from scenes import LabLimits, Noise, PublicPack

_SLACK = 1e-9
"""Share of a limit by which rounding errors may exceed it."""
_QUANTITIES: tuple[Quantity, ...] = ("position", "velocity", "angle", "spin")


def check_load(limits: LabLimits, kind: Literal["force", "torque"], load: Sequence[float]) -> None:
    """Refuse a force [N] or torque [N·m] that is larger than the scene allows.

    Raises:
        BeyondLimit: Its magnitude is beyond the limit.
    """
    limit, unit = (limits.force, "N") if kind == "force" else (limits.torque, "N·m")
    size = math.hypot(*load)
    if limit is None or size <= limit * (1 + _SLACK):
        return
    if limit == 0:
        raise BeyondLimit(f"no {kind} can be applied in this laboratory")
    raise BeyondLimit(f"a {kind} of {size:.6g} {unit} is too large: at most {limit:g} {unit} can be applied here")


def check_created_mass(limits: LabLimits, created: float, mass: float) -> None:
    """Refuse an object that would bring the mass of all created objects beyond the limit.

    Args:
        limits: The limits of the scene.
        created: Mass created so far, deleted objects too [kg].
        mass: Mass of the new object [kg].

    Raises:
        BeyondLimit: It would.
    """
    limit = limits.created_mass
    if limit is None or created + mass <= limit * (1 + _SLACK):
        return
    raise BeyondLimit(
        f"an object of {mass:.6g} kg is too heavy: of the {limit:g} kg that can be created here,"
        f" {max(0.0, limit - created):.6g} kg are left, and what is deleted does not come back"
    )


def readout_of(public: PublicPack) -> Readout:
    """The instruments of a scene. Their noise is the same for all seeds, so it reveals nothing."""
    said = public.instruments
    if said is None:
        return EXACT
    noise = said.noise or Noise()
    fineness: dict[Quantity, Fineness] = {}
    for quantity in _QUANTITIES:
        fine = Fineness(getattr(said, quantity), getattr(noise, quantity))
        if fine != Fineness():
            fineness[quantity] = fine
    return Readout(fineness, str(public.scene_id))
