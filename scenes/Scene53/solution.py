"""Scene 53: the momentum of a slider that started from rest points down its slope and tells its acceleration."""

from math import hypot

from scenes.protocol import answer, call

SLIDERS = ("object_1", "object_2")
GRAVITY = 9.81
RUN_S = 1.0
ALIKE = 1.1
"""The coefficients are equal, or a quarter apart."""


def _friction(along, down, acceleration):
    """μ = tan θ - a / (g cos θ), from the direction of motion and the acceleration."""
    slant = hypot(along, down)
    return down / along - acceleration / (GRAVITY * along / slant)


def _rougher(first, second):
    """The slider with the larger coefficient, or 0."""
    if max(first, second) < ALIKE * min(first, second):
        return "0"
    return SLIDERS[0] if first > second else SLIDERS[1]


def solve(task):
    """The momentum of one kilogram is the velocity; from rest it is a t."""
    readings = yield [
        call("step", duration=RUN_S),
        *(call("get_momentum", object_id=slider, mass=1.0) for slider in SLIDERS),
    ]
    speeds = [(reading["momentum"]["x"], -reading["momentum"]["z"]) for reading in readings[1:]]
    yield [answer(_rougher(*(_friction(x, z, hypot(x, z) / RUN_S) for x, z in speeds)))]


def theory(knobs):
    """The slider that was drawn."""
    return f"object_{knobs['rougher']}" if knobs["rougher"] else "0"


def measure(engine, knobs):
    """From distances over half the time, a = 2 s / t²."""
    starts = [engine.pose(slider).position for slider in SLIDERS]
    engine.step(engine.whole_steps(RUN_S / 2))
    moved = [engine.pose(slider).position - start for slider, start in zip(SLIDERS, starts, strict=True)]
    return _rougher(*(_friction(way[0], -way[2], 2 * hypot(way[0], way[2]) / (RUN_S / 2) ** 2) for way in moved))
