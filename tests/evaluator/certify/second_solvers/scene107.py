"""Remove both outer props at once, and see on which plate, if any, the plank falls."""

from scenes.protocol import Protocol, answer, call

LOOK_EVERY = 0.05
"""Time between two looks at the plates [s]."""
LOOKS = 60
"""Looks in all: 3 s, far longer than a fall through the 0.05 m above a plate."""


def solve(task: str) -> Protocol:
    """On the middle prop alone the plank tips to the side of its centre of mass, unless that is above the prop.

    Then the outer prop on the other side can be removed; if the plank does not tip, both can.
    """
    yield [
        call("delete_objects", object_id="object_2"),
        call("delete_objects", object_id="object_4"),
    ]
    looks = (
        yield [
            call("step", duration=LOOK_EVERY),
            call("detect_collision", obj1_id="object_1", obj2_id="object_5", elastic_response=False),
            call("detect_collision", obj1_id="object_1", obj2_id="object_6", elastic_response=False),
        ]
        * LOOKS
    )
    left = any(look["collision_detected"] for look in looks[1::3])
    right = any(look["collision_detected"] for look in looks[2::3])
    yield [answer("object_4" if left and not right else "object_2" if right and not left else "0")]
