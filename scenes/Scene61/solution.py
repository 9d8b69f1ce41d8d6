"""Scene 61: the same torque on both for the same time; the larger inertia turns slower."""

from scenes.protocol import answer, call

DRUMS = ("object_1", "object_2")
TORQUE = 1.0
TWIST_S = 1.0
ALIKE = 0.1


def _verdict(first, second):
    if abs(first - second) < ALIKE * max(first, second):
        return "0"
    return DRUMS[0] if first < second else DRUMS[1]


def solve(task):
    """With one mass in both, ω = 2 E / L; divided by the torque that is set, it compares inertias."""
    readings = yield [
        *(call("apply_torque", object_id=drum, torque_vector=[0, 0, TORQUE]) for drum in DRUMS),
        *(call("get_torque", object_id=drum) for drum in DRUMS),
        call("step", duration=TWIST_S),
        *(call("get_rotational_energy", object_id=drum, mass=1.0) for drum in DRUMS),
        *(call("get_angular_momentum", object_id=drum, mass=1.0) for drum in DRUMS),
    ]
    torques = [set_on["torque"]["z"] for set_on in readings[2:4]]
    rates = [
        2 * energy["rotational_energy"] / spin["angular_momentum"]["z"] / torque
        for energy, spin, torque in zip(readings[5:7], readings[7:], torques, strict=True)
    ]
    yield [answer(_verdict(*rates))]


def theory(knobs):
    """The drum that was drawn."""
    return f"object_{knobs['larger']}" if knobs["larger"] else "0"


def measure(engine, knobs):
    """The engine's own angular speeds after half the time."""
    for drum in DRUMS:
        engine.push(drum, torque=[0.0, 0.0, TORQUE])
    engine.step(engine.whole_steps(TWIST_S / 2))
    return _verdict(*(float(engine.twist(drum).angular[2]) for drum in DRUMS))
