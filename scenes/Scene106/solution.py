"""Scene 106: weld the ball to the rotor, swing it, and time the passages through the rest position."""

from itertools import pairwise
from math import pi, sqrt

from scenes.protocol import answer, call

BALL_KG = 2.0
ARM = 1.0
BALL_INERTIA = 0.4 * BALL_KG * 0.05**2
KICK = 0.1
COARSE_S = 0.05
LOOKS = 24


def _look(duration):
    return [
        call("step", duration=duration),
        call("get_position", object_id="object_2"),
        call("get_velocity", object_id="object_2"),
    ]


def _passages(places, start):
    """Times at which y changes its sign, between looks by straight lines."""
    times = []
    for step, (before, after) in enumerate(pairwise(places)):
        if before * after < 0:
            times.append(start + COARSE_S * (step + before / (before - after)))
    return times


def solve(task):
    """Two passages of the rest position are half a period apart."""
    readings = yield [
        call("get_position", object_id="object_2"),
        call("move_object", object_id="object_2", x=ARM, y=0, z=1),
        call("attach_objects", object1_id="object_2", object2_id="object_1", joint="weld"),
        call("set_velocity", object_id="object_2", velocity_vector=[0, KICK, 0]),
        call("step", duration=0.1),
        call("get_position", object_id="object_2"),
    ]
    places, times = [readings[-1]["position"][1]], []
    while len(times) < 2:
        readings = yield [one for _ in range(LOOKS) for one in _look(COARSE_S)]
        places += [reading["position"][1] for reading in readings[1::3]]
        times = _passages(places, 0.1)
    yield [answer(2 * (times[1] - times[0]))]


def theory(knobs):
    """T = 2π √((I + m r² + 2 m b² / 5) / κ), b the ball's radius."""
    return 2 * pi * sqrt((knobs["inertia"] + BALL_KG * ARM**2 + BALL_INERTIA) / knobs["kappa"])


def measure(engine, knobs):
    """Three half swings of the rotor itself, by its angular speed."""
    engine.place("object_2", [ARM, 0.0, 1.0], {})
    engine.join("object_2", "object_1", "weld")
    engine.set_velocity("object_2", [0.0, KICK, 0.0])
    times, before = [], 0.0
    while len(times) < 4:
        engine.step(1)
        rate = float(engine.twist("object_1").angular[2])
        if before * rate < 0:
            times.append(engine.time - engine.timestep * rate / (rate - before))
        before = rate
    return 2 * (times[-1] - times[0]) / 3
