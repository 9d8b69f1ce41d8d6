"""Scene 111: turn the disk, weld the ring to it, turn on; angular speed is twice energy over angular momentum."""

from scenes.protocol import answer, call

FIRST, SECOND = 2.0, 1.0
LASTS_S = 2.0


def _push(torque):
    return [
        call("apply_torque", object_id="object_1", torque_vector=[0, 0, torque]),
        call("step", duration=LASTS_S),
        call("get_rotational_energy", object_id="object_1", mass=1.0),
        call("get_angular_momentum", object_id="object_1", mass=1.0),
    ]


def _rate(readings):
    """With one mass in both, E = I ω² / 2 and L = I ω give ω = 2 E / L."""
    return 2 * readings[-2]["rotational_energy"] / readings[-1]["angular_momentum"]["z"]


def solve(task):
    """Two pushes, and the ring welded on between them."""
    first = yield _push(FIRST)
    second = yield [
        call("attach_objects", object1_id="object_2", object2_id="object_1", joint="weld"),
        *_push(SECOND),
    ]
    spins = FIRST * LASTS_S, (FIRST + SECOND) * LASTS_S
    yield [answer([_rate(first), spins[0] * _rate(first) / 2, _rate(second), spins[1] * _rate(second) / 2])]


def theory(knobs):
    """ω = L / I with and without the ring; E = L ω / 2."""
    spins = FIRST * LASTS_S, (FIRST + SECOND) * LASTS_S
    rates = spins[0] / knobs["disk"], spins[1] / (knobs["disk"] + knobs["ring"])
    return [rates[0], spins[0] * rates[0] / 2, rates[1], spins[1] * rates[1] / 2]


def measure(engine, knobs):
    """Angular speeds of both bodies in the engine, and energies from the true inertias."""
    engine.push("object_1", torque=[0.0, 0.0, FIRST])
    engine.step(engine.whole_steps(LASTS_S))
    found = _motion(engine, knobs)
    engine.join("object_2", "object_1", "weld")
    engine.push("object_1", torque=[0.0, 0.0, SECOND])
    engine.step(engine.whole_steps(LASTS_S))
    return found + _motion(engine, knobs)


def _motion(engine, knobs):
    disk, ring = (float(engine.twist(body).angular[2]) for body in ("object_1", "object_2"))
    return [disk, (knobs["disk"] * disk**2 + knobs["ring"] * ring**2) / 2]
