"""Scene 54: throw the ball and read how its velocity changes."""

from scenes.protocol import answer, call

THROW = (0.0, 4.0, 6.0)
LOOK_S = 0.5
HIGH = 60.0
"""Far from the floor [m]."""


def _landing(a, g):
    """Where the throw is level again: t = 2 v / g."""
    time = 2 * THROW[2] / g
    return [a * time**2 / 2, THROW[1] * time]


def solve(task):
    """Both accelerations are changes of velocity per time, the same everywhere."""
    readings = yield [
        call("move_object", object_id="object_1", x=0, y=0, z=HIGH),
        call("set_velocity", object_id="object_1", velocity_vector=list(THROW)),
        call("step", duration=LOOK_S),
        call("get_velocity", object_id="object_1"),
    ]
    vx, _, vz = readings[-1]["velocity"]
    yield [answer(_landing((vx - THROW[0]) / LOOK_S, (THROW[2] - vz) / LOOK_S))]


def theory(knobs):
    """From the accelerations that were drawn."""
    return _landing(knobs["a"], knobs["g"])


def measure(engine, knobs):
    """The engine's own flight, with the last step shared out."""
    start = engine.pose("object_1").position
    engine.set_velocity("object_1", THROW)
    before = after = start
    while after[2] >= start[2]:
        before = after
        engine.step(1)
        after = engine.pose("object_1").position
    share = (before[2] - start[2]) / (before[2] - after[2])
    place = before + share * (after - before) - start
    return [float(place[0]), float(place[1])]
