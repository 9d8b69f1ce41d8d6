"""Scene 53: from the direction and the length of each slide to the friction."""

from math import hypot

from scenes.protocol import answer, call

BLOCKS = ("object_1", "object_2")
GRAVITY = 9.81
SLIDE_S = 0.8
ALIKE = 0.1


def _friction(run, drop):
    """Coefficient tan θ - a / (g cos θ), with the acceleration a = 2 s / t²."""
    way = hypot(run, drop)
    return drop / run - 2 * way / SLIDE_S**2 / (GRAVITY * run / way)


def _verdict(first, second):
    if abs(first - second) < ALIKE * max(first, second):
        return "0"
    return BLOCKS[0] if first > second else BLOCKS[1]


def solve(task):
    """Where each block starts and where it is after the slide."""
    places = [call("get_position", object_id=block) for block in BLOCKS]
    readings = yield [*places, call("step", duration=SLIDE_S), *places]
    found = []
    for start, end in zip(readings[:2], readings[3:], strict=True):
        (x0, _, z0), (x1, _, z1) = start["position"], end["position"]
        found.append(_friction(x1 - x0, z0 - z1))
    yield [answer(_verdict(*found))]


def theory(knobs):
    """The block that was drawn."""
    return f"object_{knobs['larger']}" if knobs["larger"] else "0"


def measure(engine, knobs):
    """From the engine's accelerations."""
    engine.step(engine.whole_steps(SLIDE_S))
    found = []
    for block in BLOCKS:
        ax, _, az = engine.acceleration(block)
        found.append(-az / ax - hypot(ax, az) / (GRAVITY * ax / hypot(ax, az)))
    return _verdict(*found)
