"""The engine as `measure` sees it: a drawn world without permissions, budgets or hidden things."""

from physment_mcp.world import World


def drawn_world(mjcf: str, timestep: float | None = None) -> World:
    """The world of a drawn scene at its start.

    Args:
        mjcf: The model with the drawn values in it.
        timestep: Replaces the scene's time step [s], to see how much of a value is discretisation.
    """
    return World(mjcf, timestep)
