"""Push the bed away under the load and release it: only friction accelerates the load until it rests on the bed."""

from scenes.protocol import Protocol, answer, call

FORCE = 3000.0
"""Strong push at the trolley [N]."""
PUSH_TIME = 0.1
TIME_STEP = 0.005
"""Of the simulation, and between two looks [s]."""
LOOKS = 600
SLOWEST, FASTEST = 0.05, 0.2
"""Range of slip speeds that are used [m/s]; friction is smaller in the last step before rest."""


def line(points: list[tuple[float, float]]) -> float:
    """Value at 0 of the straight line that fits the points best."""
    mean_x = sum(x for x, _ in points) / len(points)
    mean_y = sum(y for _, y in points) / len(points)
    slope = sum((x - mean_x) * (y - mean_y) for x, y in points) / sum((x - mean_x) ** 2 for x, _ in points)
    return mean_y - slope * mean_x


def solve(task: str) -> Protocol:
    """Extrapolate the load's acceleration, from its positions, to zero slip."""
    readings = yield [
        call("apply_force", object_id="object_1", force_vector=[FORCE, 0, 0]),
        call("step", duration=PUSH_TIME),
        call("apply_force", object_id="object_1", force_vector=[0, 0, 0]),
        *[
            call("step", duration=TIME_STEP),
            call("get_position", object_id="object_1"),
            call("get_position", object_id="object_2"),
        ]
        * LOOKS,
    ]
    bed, load = ([r["position"][0] for r in readings[first::3]] for first in (4, 5))
    points: list[tuple[float, float]] = []
    for i in range(1, LOOKS - 1):
        slip = (bed[i + 1] - bed[i - 1] - load[i + 1] + load[i - 1]) / (2 * TIME_STEP)
        acceleration = (load[i + 1] - 2 * load[i] + load[i - 1]) / TIME_STEP**2
        if SLOWEST < slip < FASTEST:
            points.append((slip, acceleration))
    yield [answer(line(points))]
