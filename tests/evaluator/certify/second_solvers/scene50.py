"""Scene 50, another way: the equation of motion is fitted to recorded positions, without waiting for a period or rest.

Under a constant push from rest F = m x'' + c x' + k x holds at every moment; the record of the first swing, step by
step, gives m, c and k by least squares.
"""

from scenes.protocol import Protocol, answer, call

TIME_STEP = 0.005
PUSH = 1.0
STEPS = 200


def solved(matrix: list[list[float]], right: list[float]) -> list[float]:
    """Solution of a small set of linear equations, by elimination."""
    rows = [[*row, value] for row, value in zip(matrix, right, strict=True)]
    size = len(rows)
    for i in range(size):
        pivot = max(range(i, size), key=lambda j: abs(rows[j][i]))
        rows[i], rows[pivot] = rows[pivot], rows[i]
        for j in range(size):
            if j != i:
                factor = rows[j][i] / rows[i][i]
                rows[j] = [a - factor * b for a, b in zip(rows[j], rows[i], strict=True)]
    return [rows[i][size] / rows[i][i] for i in range(size)]


def solve(task: str) -> Protocol:
    """Push, record and fit."""
    look = call("get_position", object_id="object_2")
    readings = yield [
        call("find_objects"),
        look,
        call("apply_force", object_id="object_2", force_vector=[PUSH, 0, 0]),
        *[call("step", duration=TIME_STEP), look] * STEPS,
    ]
    rest = readings[1]["position"][0]
    places = [0.0, 0.0] + [r["position"][0] - rest for r in readings[4::2]]
    terms: list[tuple[float, float, float]] = []
    for x0, x1, x2 in zip(places, places[1:], places[2:], strict=False):
        terms.append(((x2 - 2 * x1 + x0) / TIME_STEP**2, (x2 - x1) / TIME_STEP, x1))
    normal = [[sum(t[i] * t[j] for t in terms) for j in range(3)] for i in range(3)]
    mass, _, _ = solved(normal, [PUSH * sum(t[i] for t in terms) for i in range(3)])
    yield [answer(mass)]
