"""Scene 52: let the plank begin to turn and read its angular momentum."""

from scenes.protocol import answer, call

BEGIN_S = 0.1
LEVEL_SPIN = 1e-4
"""Angular momentum [kg·m²/s] below which the plank is taken to be level; a sinking load gives far more."""
WATCH_S = 1.0
LEVEL_M = 1e-3


def solve(task):
    """Turning about +y takes the +x end, with object_3, down."""
    readings = yield [
        call("step", duration=BEGIN_S),
        call("get_angular_momentum", object_id="object_1", mass=2.0),
    ]
    spin = readings[-1]["angular_momentum"]["y"]
    yield [answer("0" if abs(spin) < LEVEL_SPIN else "object_3" if spin > 0 else "object_2")]


def theory(knobs):
    """The load that was drawn to outweigh the rest."""
    return f"object_{knobs['sinks']}" if knobs["sinks"] else "0"


def measure(engine, knobs):
    """The heights of the loads after a second in the engine."""
    loads = ("object_2", "object_3")
    before = [engine.pose(load).position[2] for load in loads]
    engine.step(engine.whole_steps(WATCH_S))
    sunk = [start - engine.pose(load).position[2] for start, load in zip(before, loads, strict=True)]
    return "0" if max(sunk) < LEVEL_M else loads[sunk.index(max(sunk))]
