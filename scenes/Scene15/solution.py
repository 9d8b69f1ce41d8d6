"""Scene 15: send one glider against the other and compare the speeds afterwards."""

from scenes.protocol import answer, call

SPEED = 2.0
ENERGY_LOSS = 0.02
TOGETHER = 0.1


def _verdict(first, second):
    """From the speeds after the collision: energy kept, or the share of the speed at which they part."""
    kept = (first**2 + second**2) / SPEED**2
    if kept > 1 - ENERGY_LOSS:
        return "1"
    return "3" if (second - first) / SPEED < TOGETHER else "2"


def solve(task):
    """One second is enough for them to meet and to part."""
    readings = yield [
        call("set_velocity", object_id="object_1", velocity_vector=[SPEED, 0, 0]),
        call("step", duration=1.0),
        *(call("get_momentum", object_id=glider, mass=1.0) for glider in ("object_1", "object_2")),
    ]
    yield [answer(_verdict(*(reading["momentum"]["x"] for reading in readings[-2:])))]


def theory(knobs):
    """The kind that was drawn."""
    return str(knobs["kind"])


def measure(engine, knobs):
    """The same collision in the engine, half as fast: the law of contact is linear."""
    engine.set_velocity("object_1", [SPEED / 2, 0.0, 0.0])
    engine.step(engine.whole_steps(2.0))
    return _verdict(*(2 * float(engine.twist(glider).linear[0]) for glider in ("object_1", "object_2")))
