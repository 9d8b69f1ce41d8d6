"""Scene 78: halve the range of launch speeds by whether the ball rolls before the mark or skids beyond it."""

import cmath

import numpy as np

from scenes.protocol import answer, call

GRAVITY = 9.81
MASS, RADIUS = 2.0, 0.1
MARK = 6.0
SLOW, FAST = 2.0, 25.0
ROUNDS = 10
REST_S = 60.0
LOOK_S, LOOKS = 0.125, 32
NEARLY_ROLLS = 0.15
"""The end of the skid is extrapolated from looks with more slip of the lowest point than this, in m/s."""


def _launch(speed):
    """Launch the ball, and follow place, speed and spin until it surely rolls or is past the mark."""
    look = [
        call("step", duration=LOOK_S),
        call("get_center_of_mass"),
        call("get_momentum", object_id="object_1", mass=MASS),
        call("get_rotational_energy", object_id="object_1", mass=MASS),
        call("get_angular_momentum", object_id="object_1", mass=MASS),
    ]
    return [
        call("move_object", object_id="object_1", x=0, y=0, z=RADIUS),
        call("set_velocity", object_id="object_1", velocity_vector=[speed, 0, 0]),
        *(look * LOOKS),
    ]


def _spin(energy, momentum):
    """With one mass in both, ω = 2 E / L."""
    around = momentum["angular_momentum"]["y"]
    return 2 * energy["rotational_energy"] / around if abs(around) > 1e-12 else 0.0


def _end_of_skid(places, speeds, slips):
    """Where the slip vanishes, extrapolated from the last two looks with clear slip."""
    last = next((index for index, slip in enumerate(slips) if slip < NEARLY_ROLLS), len(slips)) - 1
    if last == len(slips) - 1:
        return places[-1]
    if last < 1:
        return 0.0
    return places[last] + speeds[last] * LOOK_S * slips[last] / (slips[last - 1] - slips[last])


def solve(task):
    """Faster launches skid farther; drag and line bring the ball to rest before the next."""
    slow, fast = SLOW, FAST
    for _ in range(ROUNDS):
        middle = (slow + fast) / 2
        looks = (yield [*_launch(middle), call("step", duration=REST_S)])[2:-1]
        places = [reading["center_of_mass"]["x"] for reading in looks[1::5]]
        speeds = [reading["momentum"]["x"] / MASS for reading in looks[2::5]]
        spins = [_spin(energy, momentum) for energy, momentum in zip(looks[3::5], looks[4::5], strict=True)]
        slips = [speed - spin * RADIUS for speed, spin in zip(speeds, spins, strict=True)]
        slow, fast = (middle, fast) if _end_of_skid(places, speeds, slips) < MARK else (slow, middle)
    yield [answer((slow + fast) / 2)]


def _root(function, low, high):
    """Zero of a function that is negative at `low` and positive at `high`."""
    for _ in range(50):
        middle = (low + high) / 2
        low, high = (middle, high) if function(middle) < 0 else (low, middle)
    return (low + high) / 2


def _motion(place, speed, slows, drag, pull):
    """Place and speed as functions of time for x'' = -slows - drag x' - pull x."""
    root = cmath.sqrt(drag**2 / 4 - pull)
    first, second = -drag / 2 + root, -drag / 2 - root
    rest = -slows / pull
    share = (speed - second * (place - rest)) / (first - second)
    other = place - rest - share

    def at(time):
        one, two = share * cmath.exp(first * time), other * cmath.exp(second * time)
        return rest + (one + two).real, (first * one + second * two).real

    return at


def _free_motion(speed, slows, drag):
    """The same from x = 0 without the pull."""

    def at(time):
        fading = cmath.exp(-drag * time).real
        terminal = slows / drag
        return (speed + terminal) * (1 - fading) / drag - terminal * time, (speed + terminal) * fading - terminal

    return at


def theory(knobs):
    """Launch speed for which v, slowed by friction, drag and line, meets ω R, growing by 5 μ g / 2, at the mark."""
    slows, drag, taut = knobs["mu"] * GRAVITY, knobs["drag"] / MASS, knobs["taut"]

    def end_of_skid(speed):
        free = _free_motion(speed, slows, drag)
        end = _root(lambda time: 2.5 * slows * time - free(time)[1], 0.0, speed / slows)
        if free(end)[0] < taut:
            return free(end)[0]
        start = _root(lambda time: free(time)[0] - taut, 0.0, end)
        tied = _motion(0.0, free(start)[1], slows, drag, knobs["k"] / MASS)
        end = _root(lambda time: 2.5 * slows * time - tied(time - start)[1], start, end)
        return taut + tied(end - start)[0]

    return _root(lambda speed: end_of_skid(speed) - MARK, SLOW / 2, 2 * FAST)


def measure(engine, knobs):
    """A search in the engine with looks eight times as dense."""
    start, look_s = engine.save(), LOOK_S / 8

    def end_of_skid(speed):
        engine.restore(start)
        engine.set_velocity("object_1", np.array([speed, 0.0, 0.0]))
        place, velocity, slip, before = 0.0, speed, speed, 2 * speed
        while place < MARK + 1:
            engine.step(engine.whole_steps(look_s))
            twist = engine.twist("object_1")
            now = twist.linear[0] - twist.angular[1] * RADIUS
            if now < NEARLY_ROLLS:
                return place + velocity * look_s * slip / (before - slip)
            place, velocity = engine.pose("object_1").position[0], twist.linear[0]
            slip, before = now, slip
        return place

    low, high = SLOW, FAST
    for _ in range(13):
        middle = (low + high) / 2
        low, high = (middle, high) if end_of_skid(middle) < MARK else (low, middle)
    return float((low + high) / 2)
