"""Scene 97, another way: not from rest positions, but from the first two steps of the block's motion.

The block rests at x = 0, where its spring is relaxed; the hidden object is moved to s at once. In the first step only
the line pulls, with k (s - L), against mass and damping. Comparing the second step with the first gives the damping.
"""

from scenes.protocol import Call, Protocol, answer, call

MASS, SPRING = 1.0, 200.0
TIME_STEP = 0.005
HOME = 0.3
PLACES = [0.4 + 0.05 * i for i in range(60)]
SETTLING = 2.0
FARTHEST = 0.01  # m, clearly before the stop


def jerk(place: float) -> list[Call]:
    """Let the block settle, move the object to its position and read the speeds after one and two steps."""
    speed = [call("step", duration=TIME_STEP), call("get_velocity", object_id="object_1")]
    return [
        call("move_object", object_id="object_2", x=HOME, y=0, z=1),
        call("step", duration=SETTLING),
        call("move_object", object_id="object_2", x=place, y=0, z=1),
        *speed,
        *speed,
        call("get_position", object_id="object_1"),
    ]


def solve(task: str) -> Protocol:
    """Pull from many positions; where the line is taut and the stop is not reached, fit force against position."""
    yield [call("find_objects")]
    trials = [jerk(place) for place in PLACES]
    readings = yield [c for trial in trials for c in trial]
    size = len(trials[0])
    taut: list[tuple[float, float, float]] = []
    for i, place in enumerate(PLACES):
        *_, first, _, second, where = readings[i * size : (i + 1) * size]
        v1, v2 = first["velocity"][0], second["velocity"][0]
        if v1 > 1e-3 and where["position"][0] < FARTHEST:
            taut.append((place, v1, v2 - v1))
    (s0, v0, _), (s1, v1, _) = taut[0], taut[-1]
    length = s0 - v0 * (s1 - s0) / (v1 - v0)
    stiffness = 0.0
    for _ in range(20):
        per_step = (SPRING + stiffness) * TIME_STEP**2 / MASS
        forces = [MASS * v / TIME_STEP * (1 - per_step) * v / gain for _, v, gain in taut]
        stiffness = sum(f / (s - length) for f, (s, _, _) in zip(forces, taut, strict=True)) / len(taut)
    yield [answer([length, stiffness])]
