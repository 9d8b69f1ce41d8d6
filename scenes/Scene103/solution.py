"""Scene 103: free the disk, turn it twice, and read its angular speed as twice its energy over its angular momentum."""

from scenes.protocol import answer, call

FIRST, SECOND = 4.0, 2.0
LASTS_S = 2.0


def _push(torque):
    return [
        call("apply_torque", object_id="object_1", torque_vector=[0, 0, torque]),
        call("get_torque", object_id="object_1"),
        call("step", duration=LASTS_S),
        call("get_rotational_energy", object_id="object_1", mass=1.0),
        call("get_angular_momentum", object_id="object_1", mass=1.0),
    ]


def _rate(readings):
    """With one mass in both, E = I ω² / 2 and L = I ω give ω = 2 E / L."""
    return 2 * readings[-2]["rotational_energy"] / readings[-1]["angular_momentum"]["z"]


def solve(task):
    """The torque set is the torque that acts; the total angular momentum is its sum over time."""
    first = yield [call("delete_objects", object_id="object_2"), *_push(FIRST)]
    second = yield _push(SECOND)
    spin = first[2]["torque"]["z"] * LASTS_S
    more = spin + second[1]["torque"]["z"] * LASTS_S
    yield [answer([_rate(first), spin * _rate(first) / 2, _rate(second), more * _rate(second) / 2])]


def theory(knobs):
    """ω = L / (I1 + I2), E = L ω / 2."""
    spins = (FIRST * LASTS_S, (FIRST + SECOND) * LASTS_S)
    rates = [spin / (knobs["disk"] + knobs["drum"]) for spin in spins]
    return [rates[0], spins[0] * rates[0] / 2, rates[1], spins[1] * rates[1] / 2]


def measure(engine, knobs):
    """Angular speeds of both rotors in the engine, and their energies from the true inertias."""
    engine.remove("object_2")
    found = []
    for torque in (FIRST, SECOND):
        engine.push("object_1", torque=[0.0, 0.0, torque])
        engine.step(engine.whole_steps(LASTS_S))
        disk, drum = (float(engine.twist(body).angular[2]) for body in ("object_1", "object_3"))
        found += [disk, (knobs["disk"] * disk**2 + knobs["drum"] * drum**2) / 2]
    return found
