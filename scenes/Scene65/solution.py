"""Scene 65: let the bar come to rest and read how it is turned."""

from scenes.protocol import answer, call

AXIS_Z = 2.0
REST_S = 40.0


def solve(task):
    """The first arm dips by the angle whose tangent is the ratio of the masses."""
    readings = yield [call("step", duration=REST_S), call("get_position", object_id="object_1")]
    turned = yield [call("quat_to_rot_matrix", q=readings[-1]["orientation"])]
    # The first column is the direction of the first arm.
    first_arm = [row[0] for row in turned[0]["rotation_matrix"]]
    yield [answer(-first_arm[2] / first_arm[0])]


def theory(knobs):
    """The ratio that was drawn."""
    return knobs["ratio"]


def measure(engine, knobs):
    """The angle at which the engine's bar, let go slowly, has no acceleration: its rest, waited for twice as long."""
    engine.step(engine.whole_steps(2 * REST_S))
    x, _, z = engine.pose("object_1").position
    return float((AXIS_Z - z) / x)
