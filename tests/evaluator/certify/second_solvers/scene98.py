"""Scene 98, another way: energy over angular momentum gives the angular speeds, and coasting gives the friction.

For any assumed mass, 2 E / L is the angular speed of a body, so both angular speeds and their ratio can be read in
motion. A torque T on the flywheel gives the angular acceleration (T - friction) / J, and coasting gives -friction / J.
The difference is T / J, where J = flywheel + crank · ratio².
"""

from scenes.protocol import Call, Protocol, Reading, answer, call

CRANK, FLYWHEEL = "object_1", "object_2"
CRANK_INERTIA = 0.050
TORQUES = [0.5 * 1.5**i for i in range(13)]
DRIVE, COAST, REST = 0.02, 0.01, 1.0
FEWEST = 3  # least ratio of torque to friction


def rates() -> list[Call]:
    """Read energy and angular momentum of both bodies."""
    tools = ("get_rotational_energy", "get_angular_momentum")
    return [call(tool, object_id=body, mass=1.0) for body in (CRANK, FLYWHEEL) for tool in tools]


def rate(readings: list[Reading]) -> float:
    """Angular speed of a body."""
    momentum = readings[1]["angular_momentum"]["y"]
    return 2 * readings[0]["rotational_energy"] / momentum if momentum else 0.0


def trial(torque: float) -> list[Call]:
    """Drive the flywheel and let it coast, with four readings; then let it come to rest."""
    calls: list[Call] = []
    for size in (torque, 0.0):
        calls.append(call("apply_torque", object_id=FLYWHEEL, torque_vector=[0, size, 0]))
        for duration in (0.005, DRIVE if size else COAST):
            calls += [call("step", duration=duration), *rates()]
    calls.append(call("step", duration=REST))
    return calls


def solve(task: str) -> Protocol:
    """Use the smallest torque that is well above the friction."""
    yield [call("find_objects")]
    found = (0.0, 0.0)
    for torque in TORQUES:
        readings = yield trial(torque)
        looks = [readings[i : i + 4] for i in (2, 7, 13, 18)]
        cranks, wheels = [rate(look[:2]) for look in looks], [rate(look[2:]) for look in looks]
        driven, coasting = (wheels[1] - wheels[0]) / DRIVE, (wheels[3] - wheels[2]) / COAST
        if driven > -FEWEST * coasting > 0 and wheels[1] > 0.01:
            ratio = cranks[1] / wheels[1]
            found = ratio, torque / (driven - coasting) - CRANK_INERTIA * ratio**2
            break
    yield [answer(list(found))]
