"""Scene 26, another way: no ramp is used; horizontal pushes on the bench take the place of the tilts.

On a ramp of tilt t the slider slides if m g sin t > mu m g cos t, which is when a horizontal push of m g tan t moves it
on the bench. The mass comes from a known push in mid air from rest, where neither friction nor drag acts.
"""

from math import radians, tan

from scenes.protocol import Call, Protocol, answer, call

GRAVITY, TIME_STEP = 9.81, 0.005
TRIAL_PUSH = 1.0
REST = (0.0, -1.0, 1.1)
RAMPS = range(1, 13)
PUSHED_FOR = 0.4
SLID = 0.01  # m, more than a held slider creeps


def lift_and_push(height: float, push: float) -> list[Call]:
    """Put the slider at rest at this height above its place, and push it along x."""
    x, y, z = REST
    return [
        call("move_object", object_id="object_1", x=x, y=y, z=z + height),
        call("set_velocity", object_id="object_1", velocity_vector=[0, 0, 0]),
        call("apply_force", object_id="object_1", force_vector=[push, 0, 0]),
    ]


def trial(push: float) -> list[Call]:
    """Let the slider settle, push it and read how far it moves."""
    return [
        *lift_and_push(0, 0),
        call("step", duration=0.5),
        call("get_position", object_id="object_1"),
        call("apply_force", object_id="object_1", force_vector=[push, 0, 0]),
        call("step", duration=PUSHED_FOR),
        call("get_position", object_id="object_1"),
    ]


def solve(task: str) -> Protocol:
    """Measure the slider's mass, then try the pushes that correspond to the ramps."""
    aloft = lift_and_push(5.0, TRIAL_PUSH)
    readings = yield [*aloft, call("step", duration=TIME_STEP), call("get_velocity", object_id="object_1")]
    mass = TRIAL_PUSH * TIME_STEP / readings[-1]["velocity"][0]
    trials = [trial(mass * GRAVITY * tan(radians(9 + 3 * i))) for i in RAMPS]
    readings = yield [c for calls in trials for c in calls]
    places = [r["position"][0] for r in readings if set(r) >= {"position", "orientation"}]
    slides = [after - before > SLID for before, after in zip(places[::2], places[1::2], strict=True)]
    yield [answer(RAMPS[slides.index(True)])]
