"""Scene 98: raise the torque until the flywheel turns, and compare two accelerations between the stops."""

from scenes.protocol import answer, call

CRANK_INERTIA = 0.05
FIRST_NM = 0.2
RAISE = 1.35
PUSH_S, MORE_S = 0.2, 0.1
MORE = 1.3
"""The second torque, in units of the first that turns the flywheel."""
TURNS = 0.02
"""An angular speed that tells motion from creeping, in rad/s."""


def _rate(energy, momentum):
    """With one mass in both, ω = 2 E / L."""
    spin = momentum["angular_momentum"]["y"]
    return 2 * energy["rotational_energy"] / spin if abs(spin) > 1e-12 else 0.0


def _push(wheel, torque, duration):
    return [
        call("apply_torque", object_id=wheel, torque_vector=[0, torque, 0]),
        call("get_torque", object_id=wheel),
        call("step", duration=duration),
        call("get_rotational_energy", object_id=wheel, mass=1.0),
        call("get_angular_momentum", object_id=wheel, mass=1.0),
        call("get_rotational_energy", object_id="object_1", mass=1.0),
        call("get_angular_momentum", object_id="object_1", mass=1.0),
    ]


def solve(task):
    """Raise the torque until the flywheel turns; then a little more, for so short that the crank is not at its stop."""
    found = yield [call("find_objects")]
    wheel = found[0]["revealed"][0]["object_id"]
    torque, before, rate = FIRST_NM, 0.0, 0.0
    while rate < TURNS:
        torque, before = torque * RAISE, rate
        readings = yield _push(wheel, torque, PUSH_S)
        rate = _rate(*readings[3:5])
    more = yield _push(wheel, MORE * torque, MORE_S)
    faster, crank = _rate(*more[3:5]), _rate(*more[5:7])
    gear = crank / faster
    # The dry friction is in both accelerations alike.
    total = (MORE - 1) * torque / ((faster - rate) / MORE_S - (rate - before) / PUSH_S)
    yield [answer([gear, total - gear**2 * CRANK_INERTIA])]


def theory(knobs):
    """The gear and the inertia that were drawn."""
    return [knobs["gear"], knobs["inertia"]]


def measure(engine, knobs):
    """Two short pushes from rest, well above the friction."""
    start, rates = engine.save(), []
    total = knobs["inertia"] + knobs["gear"] ** 2 * CRANK_INERTIA
    torques = [knobs["friction"] + total * alpha for alpha in (2.0, 4.0)]
    for torque in torques:
        engine.restore(start)
        engine.push("object_2", torque=[0.0, torque, 0.0])
        engine.step(engine.whole_steps(0.3))
        rates.append(float(engine.twist("object_2").angular[1]))
    gear = float(engine.twist("object_1").angular[1]) / rates[1]
    total = (torques[1] - torques[0]) * 0.3 / (rates[1] - rates[0])
    return [gear, total - gear**2 * CRANK_INERTIA]
