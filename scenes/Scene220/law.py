"""Scene 220: which law the reference infers; see `scenes.reference_laws`."""

import math


def inferred(solution, readings):
    """The law that fits best, with a mass near its first estimate, and its phase at the start."""
    structure, constants = solution.FLOOR._near(readings).inferred(readings)
    turned = 2 * math.pi * solution.MIDWAY_S / constants["period"]
    return structure, {**constants, "phase": constants["phase_midway"] - turned}
