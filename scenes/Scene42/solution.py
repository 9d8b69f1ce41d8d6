"""Scene 42: the least ball that sinks and the greatest that is lifted lie equally far from the load."""

from math import pi, sqrt

import numpy as np

from scenes.protocol import answer, call

RADIUS = 0.1
VOLUME = 4 / 3 * pi * RADIUS**3
PAN_Z = 1.0
TRAVEL = 0.05
CLEARANCE = 5e-4
"""A ball is made this far above the lowered pan [m], which may have sunk a little more or less than told."""
BALLAST_KG = 30.0
LIGHT, HEAVY = 0.1, 15.0
ROUNDS = 11
WATCH_S = 2.0
RETURN_S = 6.0
MOVED_M = 5e-3


def _set_in(name, mass, pan_z):
    return call("create_objects", name=name, pos=[0, 0, pan_z + RADIUS], density=mass / VOLUME, rgba=[1, 0, 0, 1])


def _round(number, to_sink, to_lift):
    """Does one ball sink in the raised pan? Is another lifted in the pan that ballast has lowered?"""
    return [
        _set_in(f"sink{number}", to_sink, PAN_Z),
        call("step", duration=WATCH_S),
        call("get_position", object_id="object_2"),
        call("delete_objects", object_id=f"sink{number}"),
        call("step", duration=RETURN_S),
        _set_in(f"ballast{number}", BALLAST_KG, PAN_Z),
        call("step", duration=WATCH_S),
        call("get_position", object_id="object_2"),
        call("delete_objects", object_id=f"ballast{number}"),
        _set_in(f"lift{number}", to_lift, PAN_Z - TRAVEL + CLEARANCE),
        call("step", duration=WATCH_S),
        call("get_position", object_id="object_2"),
        call("delete_objects", object_id=f"lift{number}"),
        call("step", duration=RETURN_S),
    ]


def solve(task):
    """Halve both ranges of masses side by side."""
    sinks, lifts = [LIGHT, HEAVY], [LIGHT, HEAVY]
    for number in range(ROUNDS):
        to_sink, to_lift = sqrt(sinks[0] * sinks[1]), sqrt(lifts[0] * lifts[1])
        readings = yield _round(number, to_sink, to_lift)
        first, low, last = (readings[k]["position"][2] for k in (2, 7, 11))
        sinks[1 if PAN_Z - first > MOVED_M else 0] = to_sink
        lifts[0 if last - low > MOVED_M else 1] = to_lift
    yield [answer((sqrt(sinks[0] * sinks[1]) + sqrt(lifts[0] * lifts[1])) / 2)]


def theory(knobs):
    """The mass of the load."""
    return knobs["load"]


def _limit(engine, pan_z, sinks):
    """The engine's own limit between balls that leave the pan where it is and balls that do not."""
    start = engine.save()
    low, high = LIGHT, HEAVY
    for _ in range(14):
        mass = sqrt(low * high)
        engine.restore(start)
        place = np.array([0.0, 0.0, pan_z + RADIUS])
        before = engine.pose("object_2").position[2]
        engine.add_ball("ball", place, mass / VOLUME, RADIUS, np.ones(4), {})
        engine.step(engine.whole_steps(2 * WATCH_S))
        moved = abs(engine.pose("object_2").position[2] - before) > MOVED_M
        low, high = (low, mass) if moved == sinks else (mass, high)
    engine.restore(start)
    return sqrt(low * high)


def measure(engine, knobs):
    """Both limits in the engine, watched for longer."""
    sinks = _limit(engine, PAN_Z, True)
    engine.add_ball("ballast", np.array([0.0, 0.0, PAN_Z + RADIUS]), BALLAST_KG / VOLUME, RADIUS, np.ones(4), {})
    engine.step(engine.whole_steps(WATCH_S))
    engine.remove("ballast")
    return (sinks + _limit(engine, PAN_Z - TRAVEL + CLEARANCE, False)) / 2
