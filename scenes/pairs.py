"""Fits the laws of two bodies on rails that a gear couples. Nets catch the bodies. Used by reference protocols.

The coupling force depends on the slip s = n v1 - v2, and possibly on v2. Forces are divided by the mass of the first
body, so that this mass is the only constant with the scale of the forces.
"""

from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq

from scenes.course_record import Course, force, position, velocity
from scenes.courses import Knobs, Laws
from scenes.fitting import Array
from scenes.protocol import Call, Exchanges, Reading
from scenes.rigs import Rig

BODIES = ("object_1", "object_2")
JOINTS: Mapping[str, Callable[[Knobs, Any, Any], Any]] = {
    "oil": lambda knobs, slip, _: knobs["p"] * slip,
    "grease": lambda knobs, slip, _: knobs["p"] * slip / (knobs["w"] + np.abs(slip)),
    "paste": lambda knobs, slip, _: knobs["p"] * slip / np.sqrt(knobs["w"] + np.abs(slip)),
    "warm": lambda knobs, slip, speed: knobs["p"] * slip * np.abs(speed) / (knobs["w"] + np.abs(speed)) ** 0.5,
    "sated": lambda knobs, slip, speed: knobs["p"] * slip * np.abs(speed) / (knobs["w"] + np.abs(speed)),
    "fading": lambda knobs, slip, speed: knobs["p"] * slip * np.abs(speed) / (knobs["w"] + np.abs(speed)) ** 1.5,
}
"""Kind of joint → force that it transmits, from its slip and the speed of the second body."""
DRAGS: Mapping[str, Callable[[Any], Any]] = {
    "linear": lambda speed: speed,
    "square": lambda speed: speed * np.abs(speed),
}
"""Kind of resistance → its dependence on the speed."""
_BOX = {
    "n": (0.15, 2.6),
    "b": (0.2, 5.0),
    "c": (0.1, 5.0),
    "r": (0.05, 3.0),
    "p": (0.02, 5.0),
}
"""Ranges of the constants: gear ratio, mass of the second body over that of the first, both resistances, joint."""
_MASSES = 3.0
"""Largest ratio between the mass of the first body and its first estimate, in both directions."""
_STRIDE_S, _STOP_S, _MARGIN, _FIRMNESS = 0.05, 0.8, 1.3, 0.3
"""Time step of a plan; time for stopping the bodies; safety factor of their response; weight of the first guess."""
_TOUCH_S = 0.25
"""Duration of each of the first pushes."""
_FIRST_GAINS = 7.0, 14.0
"""Conservative guesses of the acceleration that the largest force on each of the bodies causes [m/s²]."""


@dataclass(frozen=True, slots=True)
class Pair:
    """A family of laws of two coupled bodies, one of which has a resistance of unknown form."""

    joints: Sequence[str]
    """The possible kinds of joints, from `JOINTS`."""
    open_body: int
    """Index of the body whose resistance may be any of `DRAGS`; that of the other body is linear."""
    held: int
    """Index of the body that the question keeps at a speed."""
    pushed: int
    """Number of bodies that can be pushed, from the first on."""
    sigma: tuple[float, float]
    """Standard deviations of a position and a speed [m, m/s]."""
    net: float
    """Distance of the nets from the start of each body [m]."""
    bend: tuple[float, float]
    """Range of the speed at which the force of some joints changes its slope [m/s]."""
    growth: float = 8.0
    """Ratio of each of the first pushes to the previous one."""

    @property
    def rig(self) -> Rig:
        """The controls and readings of the pair."""
        reads = [of(body, 0) for of in (position, velocity) for body in BODIES]
        return Rig([force(body, 0) for body in BODIES[: self.pushed]], reads, significant=3)

    def laws(self, course: Course) -> Laws:
        """Return the laws of every structure, such as `oil, linear`, with masses near an estimate from the readings.

        If all forces are linear, motions and steady speeds do not determine r, n, c and p separately, so r is not
        fitted.
        """
        names = {
            f"{joint}, {drag}": [
                *("m", "n", "b", "c"),
                *(() if (joint, drag) == ("oil", "linear") else ("r",)),
                *(("p",) if joint == "oil" else ("p", "w")),
            ]
            for joint in self.joints
            for drag in DRAGS
        }
        mass = 1 / max(float(_response(course, 1.0)[0, 0]), 1e-5)
        return Laws(
            rates=self.rates,
            structures=names,
            box={**_BOX, "w": self.bend, "m": (mass / _MASSES, mass * _MASSES)},
            start=(0.0, 0.0, 0.0, 0.0),
            sigma=(self.sigma[0], self.sigma[0], self.sigma[1], self.sigma[1]),
            starts=150,
            tried=2,
            rounds=10,
        )

    def _resisted(self, structure: str, knobs: Knobs, body: int, speed: Any) -> Any:
        """Return the resistance of a body."""
        drag = structure.split(", ")[1] if body == self.open_body else "linear"
        # Only the resistance of the second body may be missing from the constants.
        return (knobs["c"] if body == 0 else knobs.get("r", 0.0)) * DRAGS[drag](speed)

    def rates(self, structure: str, knobs: Knobs, _: Any, state: Array, pushes: Array) -> Array:
        """Return the time derivative of positions and speeds."""
        _, _, first, second = state
        passed = JOINTS[structure.split(", ", maxsplit=1)[0]](knobs, knobs["n"] * first - second, second)
        other = pushes[1] / knobs["m"] if self.pushed > 1 else 0.0
        gain = pushes[0] / knobs["m"] - self._resisted(structure, knobs, 0, first) - knobs["n"] * passed
        return np.array(
            [first, second, gain, (other - self._resisted(structure, knobs, 1, second) + passed) / knobs["b"]]
        )

    def steady(self, structure: str, knobs: Knobs, speed: float) -> list[float]:
        """Return the steady speed of the other body while one body is kept at a speed, and the force that keeps it."""
        n, m, joint = float(knobs["n"]), float(knobs["m"]), JOINTS[structure.split(", ", maxsplit=1)[0]]

        def slip(other: float) -> float:
            return n * speed - other if self.held == 0 else n * other - speed

        def passed(other: float) -> float:
            """Return the force that the joint transmits at a speed of the other body."""
            return float(joint(knobs, slip(other), other if self.held == 0 else speed))

        def excess(other: float) -> float:
            """Return the net force on the other body: that of the joint minus its own drag."""
            return float(
                (1.0 if self.held == 0 else -n) * passed(other) - self._resisted(structure, knobs, 1 - self.held, other)
            )

        other = brentq(excess, 0.0, n * speed if self.held == 0 else speed / n)
        back = passed(other) * (n if self.held == 0 else -1.0)
        return [other, float(m * (self._resisted(structure, knobs, self.held, speed) + back))]

    def course(self, exchanges: Exchanges) -> Course:
        """Extract pushes and readings from calls, up to the leg before a net caught a body."""
        course = self.rig.course(exchanges)
        caught = np.abs(course.readings[:, :2]) > self.net - 2 * self.sigma[0]
        return course.until(caught[:, 0] | caught[:, 1])

    def driven(
        self, first: float, greatest: float, brisk: float, levels: Sequence[tuple[float, float]], times: Sequence[float]
    ) -> Generator[list[Call], list[Reading], list[tuple[Call, Reading]]]:
        """Increase the push until the first body moves, then push the bodies back and forth without touching the nets.

        Args:
            first: Initial force [N].
            greatest: Largest force [N].
            brisk: Target acceleration of the first body [m/s²].
            levels: Forces of the legs on both bodies, as multiples of the force for this acceleration.
            times: Candidate durations of a leg; the longest that keeps both bodies off the nets is chosen [s].
        """
        touch = Rig(self.rig.controls, [velocity(BODIES[0], 0)], significant=3)
        seen, push = yield from touch.touched(
            first, self.growth, _TOUCH_S, lambda reading: abs(reading[0]) > max(6 * self.sigma[1], 0.1)
        )
        looks = [asked for asked in self.rig.leg(0.0, 0.0) if asked.tool.startswith("get")]
        seen += zip(looks, (yield looks), strict=True)
        top, sense = brisk * push * _TOUCH_S / abs(self.rig.course(seen).readings[-1, 2]) / 2, -1.0
        for level in levels:
            course = self.rig.course(seen)
            gain = float(_response(course, top)[0, 0]) / brisk
            top = min(greatest, top / np.clip(gain, 0.5, 2.0))
            pushes, duration = self._chosen(top * np.array(level), sense, times, course, top)
            sense = float(np.sign(pushes[0]) * np.sign(level[0])) or sense
            calls = self.rig.leg(pushes[: self.pushed], duration, looks=2)
            seen += zip(calls, (yield calls), strict=True)
        return seen

    def _chosen(
        self, level: Array, sense: float, times: Sequence[float], course: Course, top: float
    ) -> tuple[Array, float]:
        """Choose pushes and duration of a leg that touches no net: forwards, else backwards, else pushes that brake."""
        response = _response(course, top)
        stop = -top * np.sign(course.readings[-1, 2:])
        for pushes, duration in [
            *((sense * level, time) for time in times[: len(times) // 2]),
            *((-sense * level, time) for time in times),
        ]:
            if self._clear(course.readings[-1], pushes / top, duration, response):
                return pushes, duration
        return stop, times[-1]

    def _clear(self, reading: Array, pushes: Array, duration: float, response: Array) -> bool:
        """Predict whether both bodies stay off the nets during the pushes, and while reversed pushes stop them."""
        places, speeds = reading[:2].copy(), reading[2:].copy()
        room = np.maximum(0.85 * self.net, np.abs(places))
        pushed = np.array([1.0, self.pushed - 1.0])
        for number in range(round((duration + _STOP_S) / _STRIDE_S)):
            acting = pushes if number * _STRIDE_S < duration else -np.sign(speeds) * pushed / _MARGIN
            speeds = speeds + _STRIDE_S * (response @ [*(_MARGIN * acting * pushed), *speeds])
            places = places + _STRIDE_S * speeds
            if np.any(np.abs(places) > room):
                return False
        return True


def _response(course: Course, top: float) -> Array:
    """Fit a linear model of both accelerations to pushes, in units of `top`, and speeds; returns its coefficients."""
    states = np.vstack([np.zeros(4), np.nan_to_num(course.readings)])
    pushes = np.zeros((len(course.durations), 2))
    pushes[:, : course.controls.shape[1]] = course.controls / top
    spans = course.durations[:, None]
    table = np.hstack([pushes * spans, (states[1:, 2:] + states[:-1, 2:]) / 2 * spans])
    guess = np.array([[_FIRST_GAINS[0], 0.0], [0.0, _FIRST_GAINS[1]], [-1.0, 0.5], [0.5, -1.0]])
    sizes = np.diag(_FIRMNESS / np.array([5.0, 5.0, 1.0, 1.0]))
    found = np.linalg.lstsq(
        np.vstack([table, sizes]), np.vstack([np.diff(states[:, 2:], axis=0), sizes @ guess]), rcond=None
    )[0]
    return np.asarray(found.T, dtype=np.float64)


def kept_speed(engine: Any, held: int, speeds: Sequence[float], seconds: float) -> list[float]:
    """Measure, in the engine, the steady state of a pair while one body is kept at a speed by a huge mass.

    Args:
        engine: The engine, with the hidden values of a seed.
        held: Index of the body that is kept at its speed.
        speeds: Initial speeds of both bodies [m/s].
        seconds: Time after which the force is computed from the loss of speed during one more second.

    Returns:
        The speed of the other body, and the force on the kept body.
    """
    mass = 1e8
    free = engine.changed({f"geom[{BODIES[held]}_geom].mass": mass, "body[nets].pos": (1e6, 0.0, 0.0)})
    for body, speed in zip(BODIES, speeds, strict=True):
        free.set_velocity(body, np.array([speed, 0.0, 0.0]))
    free.step(free.whole_steps(seconds))
    before = float(free.twist(BODIES[held]).linear[0])
    free.step(free.whole_steps(1.0))
    after = float(free.twist(BODIES[held]).linear[0])
    return [float(free.twist(BODIES[1 - held]).linear[0]), (before - after) * mass]


def left_over(engine: Any, held: int, speeds: Sequence[float], push: float, off: float, seconds: float) -> float:
    """Return the relative error of the speeds that remains after a disturbance, at constant force.

    Args:
        engine: The engine, with the hidden values of a seed.
        held: Index of the body that moves at a fixed speed in the question.
        speeds: Steady speeds of both bodies [m/s].
        push: Force that keeps the speed [N].
        off: Relative disturbance of the speeds.
        seconds: Time from the disturbance to the reading of the error [s].
    """
    free = engine.changed({"body[nets].pos": (1e6, 0.0, 0.0)})
    for body, speed in zip(BODIES, speeds, strict=True):
        free.set_velocity(body, np.array([(1 + off) * speed, 0.0, 0.0]))
    free.push(BODIES[held], force=np.array([push, 0.0, 0.0]))
    free.step(free.whole_steps(seconds))
    now = np.array([float(free.twist(body).linear[0]) for body in BODIES])
    return float(np.max(np.abs(now - speeds)) / np.max(speeds))
