"""Scene 41, another way: nothing is dropped; the ball is thrown down from the surface at several speeds.

A fall from height h reaches the plate with v² = 2 g h, so throwing the ball down from the surface with v is equivalent.
Its energy is read when it has left the padding; the height of return is z + v²/2g.
"""

from math import sqrt

from scenes.protocol import Call, Protocol, Reading, answer, call

GRAVITY, TIME_STEP = 9.81, 0.005
RADIUS, DENSITY = 0.20, 200.0
LOOKS, PAUSE = 12, 0.05
PARTS, ROUNDS = 8, 6
HIGHEST = 30.0


def throw(height: float) -> list[Call]:
    """Put the ball onto the surface with the speed of a fall from this height, and read its motion."""
    calls = [
        call("move_object", object_id="ball", x=0, y=0, z=RADIUS),
        call("set_velocity", object_id="ball", velocity_vector=[0, 0, -sqrt(2 * GRAVITY * height)]),
    ]
    for _ in range(LOOKS):
        calls.append(call("step", duration=PAUSE))
        calls.append(call("get_position", object_id="ball"))
        calls.append(call("get_velocity", object_id="ball"))
    return calls


def returned(readings: list[Reading]) -> float:
    """Height of the apex, from the first reading of the ball above the plate and rising; 0 if there is none."""
    for k in range(3, len(readings), 3):
        z, v = readings[k]["position"][2] - RADIUS, readings[k + 1]["velocity"][2]
        if z > 0 and v > 0:
            return z + v * v / (2 * GRAVITY) - v * TIME_STEP / 2
    return 0.0


def solve(task: str) -> Protocol:
    """Bracket the height of which half is returned."""
    yield [call("create_objects", name="ball", pos=[0, 0, RADIUS], density=DENSITY, rgba=[1, 0, 0, 1], radius=RADIUS)]
    low, high = 0.1, HIGHEST
    for _ in range(ROUNDS):
        heights = [low * (high / low) ** (i / (PARTS - 1)) for i in range(PARTS)]
        trials = [throw(h) for h in heights]
        readings = yield [c for trial in trials for c in trial]
        size = len(trials[0])
        shares = [returned(readings[i * size : (i + 1) * size]) / h for i, h in enumerate(heights)]
        over = [i for i, share in enumerate(shares[:-1]) if share > 0.5 >= shares[i + 1]]
        if not over:
            break
        i = over[0]
        low, high = heights[i], heights[i + 1]
    yield [answer(sqrt(low * high))]
