"""A ball that slides down the panel gives the tilt; the energies of motion along the normal give the restitution.

A second ball, released on the frictionless panel without bouncing, can only slide: its path gives the slope. Along the
normal the falling ball has the constant acceleration g cos(tilt), so its normal speeds before and after the bounce
follow from its distance to the panel at any time of free flight.
"""

from math import atan2, cos, degrees, sin, sqrt

from scenes.protocol import Protocol, answer, call

GRAVITY = 9.81
RADIUS = 0.1
FACE = 1.0
"""Height of the panel's upper face at x = 0 [m]."""
DROP_HEIGHT = 2.3
FLIGHT = 0.6
"""Time after which the dropped ball has bounced and flies again [s]."""
LAY_HEIGHT = 1.12
"""Initial height of the second ball above the panel [m]."""
STOPS, PAUSE = 80, 0.02
"""How often the second ball is stopped, and the time in between [s], so that it settles without bouncing."""
SLIDE = 0.6
"""Time of the slide that is measured [s]."""


def solve(task: str) -> Protocol:
    """Drop one ball and read it in flight, then let another slide."""
    ball = {"density": 1000, "rgba": [1, 0, 0, 1], "radius": RADIUS}
    readings = yield [
        call("create_objects", name="falling", pos=[0, 0, DROP_HEIGHT], **ball),
        call("step", duration=FLIGHT),
        call("get_position", object_id="falling"),
        call("get_velocity", object_id="falling"),
        call("delete_objects", object_id="falling"),
    ]
    (x, _, z), (vx, _, vz) = readings[2]["position"], readings[3]["velocity"]

    stop = call("set_velocity", object_id="sliding", velocity_vector=[0, 0, 0])
    place = call("get_position", object_id="sliding")
    readings = yield [
        call("create_objects", name="sliding", pos=[0, 0, LAY_HEIGHT], **ball),
        *[call("step", duration=PAUSE), stop] * STOPS,
        place,
        call("step", duration=SLIDE),
        place,
    ]
    (x1, _, z1), (x2, _, z2) = readings[-3]["position"], readings[-1]["position"]
    tilt = atan2(z1 - z2, x2 - x1)

    pull = GRAVITY * cos(tilt)
    touching = 2 * pull * ((DROP_HEIGHT - FACE) * cos(tilt) - RADIUS)
    distance = x * sin(tilt) + (z - FACE) * cos(tilt)
    leaving = (vx * sin(tilt) + vz * cos(tilt)) ** 2 + 2 * pull * (distance - RADIUS)
    yield [answer([degrees(tilt), sqrt(leaving / touching)])]
