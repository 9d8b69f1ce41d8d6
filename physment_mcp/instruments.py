"""The instruments of a scene: the resolution and the noise of readings."""

from physment_mcp.world import Fineness, Readout
from physment_mcp.world.readout import EXACT, Quantity
from scenes import Noise, PublicPack

_QUANTITIES: tuple[Quantity, ...] = ("position", "velocity", "angle", "spin")


def readout_of(public: PublicPack) -> Readout:
    """Return the instruments of a scene. Their noise is the same at all seeds, so it reveals nothing."""
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
