"""Scene 55: compare the speed of each ball with its spin times its radius."""

from math import hypot

from scenes.protocol import answer, call

BALLS = ("object_1", "object_2")
RADIUS = 0.1
RUN_S = 0.8
ROLLS = 0.95
"""Share of the speed that spin times radius makes at least, if the ball rolls."""


def _verdict(first, second):
    """From the shares of both balls: the one that rolls, or 0 for both."""
    if min(first, second) > ROLLS:
        return "0"
    return BALLS[0] if first > second else BALLS[1]


def _share(energy, spin, momentum):
    """ω R / v, with ω = 2 E / L, which holds for any mass."""
    rate = 2 * energy["rotational_energy"] / abs(spin["angular_momentum"]["y"])
    return rate * RADIUS / hypot(momentum["momentum"]["x"], momentum["momentum"]["z"])


def solve(task):
    """Spin and speed of both balls, once they have run for a while."""
    instruments = ("get_rotational_energy", "get_angular_momentum", "get_momentum")
    readings = yield [
        call("step", duration=RUN_S),
        *(call(instrument, object_id=ball, mass=1.0) for ball in BALLS for instrument in instruments),
    ]
    yield [answer(_verdict(_share(*readings[1:4]), _share(*readings[4:7])))]


def theory(knobs):
    """The ball that was drawn to roll alone."""
    return f"object_{knobs['rolls']}" if knobs["rolls"] else "0"


def measure(engine, knobs):
    """From the way each ball has come and turned in half the time: a slipping ball turns by less than the way / R."""
    starts = [engine.pose(ball).position for ball in BALLS]
    turned = [0.0, 0.0]
    for _ in range(engine.whole_steps(RUN_S / 2)):
        engine.step(1)
        turned = [
            angle + engine.timestep * float(engine.twist(ball).angular[1])
            for angle, ball in zip(turned, BALLS, strict=True)
        ]
    ways = [engine.pose(ball).position - start for ball, start in zip(BALLS, starts, strict=True)]
    return _verdict(*(RADIUS * angle / hypot(way[0], way[2]) for angle, way in zip(turned, ways, strict=True)))
