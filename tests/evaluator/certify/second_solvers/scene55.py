"""Compare the distance of each ball in a known time: rolling without slipping accelerates only at 5/7 g sin(slope)."""

from math import radians, sin

from scenes.protocol import Protocol, answer, call

BALLS = ("object_1", "object_2")
TIME = 0.5
"""[s]."""
WAY = 0.5 * 5 / 7 * 9.81 * sin(radians(35)) * TIME**2
"""Distance of a solid ball that rolls without slipping [m]."""
MARGIN = 0.02
"""Relative tolerance of the distance."""


def solve(task: str) -> Protocol:
    """A ball that moves farther than a rolling ball can is slipping."""
    readings = yield [
        call("step", duration=TIME),
        *(call("get_displacement", object_id=ball) for ball in BALLS),
    ]
    ways = {ball: reading["displacement"] for ball, reading in zip(BALLS, readings[1:], strict=True)}
    rolling = [ball for ball, way in ways.items() if way < WAY * (1 + MARGIN)]
    yield [answer(rolling[0] if len(rolling) == 1 else 0)]
