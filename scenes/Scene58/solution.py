"""Scene 58: two rests of the beam, and the straight line through them."""

from math import asin, cos, hypot

from scenes.protocol import answer, call

TIP = 1.2
AXIS_Z = 1.0
SHIFT = 0.5
REST_S = 10.0


def _strain(height):
    """φ / cos φ, in proportion to what is out of balance."""
    angle = asin((AXIS_Z - height) / TIP)
    return angle / cos(angle)


def solve(task):
    """The strain is linear in the rider's distance from the axis."""
    readings = yield [
        call("step", duration=REST_S),
        call("get_position", object_id="object_1"),
        call("change_position", object_id="object_2", dx=SHIFT, dy=0, dz=0),
        call("step", duration=REST_S),
        call("get_position", object_id="object_1"),
        call("get_position", object_id="object_2"),
    ]
    first, second = _strain(readings[1]["position"][2]), _strain(readings[4]["position"][2])
    x, _, z = readings[5]["position"]
    yield [answer(hypot(x, z - AXIS_Z) * first / (first - second))]


def theory(knobs):
    """The distance that was drawn."""
    return knobs["x"]


def measure(engine, knobs):
    """From the engine's rests with the rider 1 cm short of balance and 1 cm beyond it."""
    start, strains = engine.save(), []
    for place in (knobs["x"] - 0.01, knobs["x"] + 0.01):
        engine.restore(start)
        engine.place("object_2", [place, 0.0, AXIS_Z], {})
        engine.step(engine.whole_steps(REST_S))
        strains.append(_strain(float(engine.pose("object_1").position[2])))
    return knobs["x"] - 0.01 + 0.02 * strains[0] / (strains[0] - strains[1])
