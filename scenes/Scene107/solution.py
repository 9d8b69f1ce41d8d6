"""Scene 107: take one outer prop away; if the plank stays at rest, take the other away as well."""

from scenes.protocol import answer, call

WATCH_S = 2.0
LEFT, RIGHT = "object_2", "object_4"
LEFT_PLATE, RIGHT_PLATE = "object_5", "object_6"


def _without(prop, plate):
    """Take a prop away, and see whether the plank comes down on the plate on that side."""
    return [
        call("delete_objects", object_id=prop),
        call("step", duration=WATCH_S),
        call("detect_collision", obj1_id="object_1", obj2_id=plate, elastic_response=False),
    ]


def solve(task):
    """A plank that tips comes down on the side of the missing prop."""
    readings = yield _without(LEFT, LEFT_PLATE)
    if readings[-1]["collision_detected"]:
        yield [answer(RIGHT)]
        return
    readings = yield _without(RIGHT, RIGHT_PLATE)
    yield [answer(LEFT if readings[-1]["collision_detected"] else "0")]


def theory(knobs):
    """The prop on the lighter side can go; both, if the centre of mass is above the middle one."""
    return {-1: RIGHT, 0: "0", 1: LEFT}[knobs["side"]]


def measure(engine, knobs):
    """Tip of the plank in the engine after each single removal."""
    start, stands = engine.save(), {}
    for prop in (LEFT, RIGHT):
        engine.restore(start)
        engine.remove(prop)
        engine.step(engine.whole_steps(WATCH_S))
        stands[prop] = abs(engine.pose("object_1").position[2] - 1.03) < 0.005
    return "0" if all(stands.values()) else LEFT if stands[LEFT] else RIGHT
