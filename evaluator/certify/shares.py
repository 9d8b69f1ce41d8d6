"""How many seeds a share of them is: exact from twenty seeds on; on fewer, rounded in favour of the scene."""

import math

ENOUGH_SEEDS = 20
"""Number of seeds from which on a share is taken exactly."""
_ROUNDING = 1e-9


def at_most(share: float, of: int, seeds: int) -> int:
    """The greatest number that a share may have.

    Args:
        share: From 0 to 1.
        of: Number of seeds of which it is a share.
        seeds: Number of seeds on which the scene is certified.
    """
    return math.floor(share * of + _ROUNDING) if seeds >= ENOUGH_SEEDS else math.ceil(share * of - _ROUNDING)


def at_least(share: float, of: int, seeds: int) -> int:
    """The smallest number that a share must have; arguments as for `at_most`."""
    return math.ceil(share * of - _ROUNDING) if seeds >= ENOUGH_SEEDS else math.floor(share * of + _ROUNDING)
