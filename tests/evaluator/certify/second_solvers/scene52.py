"""The direction of the plank's rotation, from its angular momentum about the y axis, not from the height of its end."""

from scenes.protocol import Protocol, answer, call

LAPSE = 0.1
"""[s]."""
STILL = 1e-6
"""Angular momentum that counts as none, for a mass of 1 kg [kg m²/s]."""
LEFT, RIGHT, LEVEL = 1, 2, 0


def solve(task: str) -> Protocol:
    """Release the plank and read its angular momentum: if this is positive about y, the right end goes down."""
    readings = yield [
        call("step", duration=LAPSE),
        call("get_angular_momentum", object_id="object_1", mass=1.0),
    ]
    spin = readings[1]["angular_momentum"]["y"]
    yield [answer(LEVEL if abs(spin) < STILL else RIGHT if spin > 0 else LEFT)]
