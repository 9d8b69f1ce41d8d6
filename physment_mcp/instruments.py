"""The instruments of a scene: the resolution and noise of readings, and the quantities with a systematic error."""

from physment_mcp.world import Fineness, Readout
from physment_mcp.world.readout import EXACT, Quantity
from physment_mcp.world.systematic import Systematic
from scenes import Noise, PublicPack

_QUANTITIES: tuple[Quantity, ...] = ("position", "velocity", "angle", "spin")
_SYSTEMATIC: tuple[Systematic, ...] = ("position", "angle")


def readout_of(public: PublicPack) -> Readout:
    """Return the instruments of a scene. Their noise is the same at all seeds, so it reveals no hidden value."""
    said = public.instruments
    if said is None:
        return EXACT
    noise = said.noise or Noise()
    fineness: dict[Quantity, Fineness] = {}
    for quantity in _QUANTITIES:
        fine = Fineness(getattr(said, quantity), getattr(noise, quantity))
        if fine != Fineness():
            fineness[quantity] = fine
    bounds = [one for one in (said.bias, said.drift) if one is not None]
    admitted: set[Systematic] = {name for name in _SYSTEMATIC if any(getattr(one, name) for one in bounds)}
    return Readout(fineness, str(public.scene_id), frozenset(admitted))
