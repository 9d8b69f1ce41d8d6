"""Scene 75: the true angular momentum is torque times time; the instrument's, for 1 kg, is one m-th of it."""

from scenes.protocol import answer, call

TORQUE = 2.0
TWIST_S = 2.0


def solve(task):
    """For 1 kg L = k² ω, and τ t = m k² ω."""
    found = yield [call("find_objects")]
    wheel = found[0]["revealed"][0]["object_id"]
    readings = yield [
        call("apply_torque", object_id=wheel, torque_vector=[0, 0, TORQUE]),
        call("step", duration=TWIST_S),
        call("get_torque", object_id=wheel),
        call("get_angular_momentum", object_id=wheel, mass=1.0),
    ]
    yield [answer(readings[2]["torque"]["z"] * TWIST_S / readings[3]["angular_momentum"]["z"])]


def theory(knobs):
    """The mass that was drawn."""
    return knobs["m"]


def measure(engine, knobs):
    """From the engine's angular speed and the true radius of gyration."""
    engine.push("object_2", torque=[0.0, 0.0, TORQUE])
    engine.step(engine.whole_steps(TWIST_S))
    return float(TORQUE * TWIST_S / (knobs["k"] ** 2 * engine.twist("object_2").angular[2]))
