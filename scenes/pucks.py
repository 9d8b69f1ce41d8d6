"""Pushes a puck over a floor, fits its laws and predicts the answer. Used by reference protocols of open worlds."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from scenes.course_record import Course, force, position, recorded, velocity
from scenes.courses import Laws
from scenes.fitting import Array
from scenes.local_law import LocalLaw
from scenes.protocol import AnswerValue, Call, Exchanges, Protocol, answer, call

PUCK = "object_1"
AXES = (0, 1)
HEAVY_KG = 1e6
"""Mass of a puck that practically keeps its velocity."""
TO_AND_FRO = (
    (0.5, 0.0, 1.0),
    (-1.0, 0.3, 1.0),
    (1.5, -0.5, 1.0),
    (-2.5, 0.0, 0.8),
    (4.0, 0.5, 0.8),
    (-6.0, 0.0, 0.8),
    (0.0, 0.0, 1.6),
    (6.0, -4.0, 0.8),
)
"""Alternating, growing pushes for a puck of unknown mass: fx, fy [N], duration [s]."""
_SIZES = (0.25, 0.5, 0.75, 1.0)
"""Candidate magnitudes of pushes, as fractions of the largest."""
_WEAK_KG = 0.5
"""Weight of the regularisation of the mass estimate if `wanders` is 0 [kg]."""
_PARTS = 8
"""Number of parts into which a push, and the coasting after it, are divided; the position is predicted for each."""


@dataclass(frozen=True, slots=True)
class PuckFloor:
    """Pushes the puck, fits its laws and predicts the answer, in SI units."""

    laws: Laws
    """The state begins with x, y, vx and vy; the controls are the forces along x and y; one of the constants is `m`."""
    predict: Callable[[str, Mapping[str, Any]], AnswerValue]
    """Computes the answer from a structure and its constants."""
    targets: Sequence[tuple[float, float]]
    """Positions to which the puck is steered, in a cycle."""
    near_m: float
    """Distance from a target at which it counts as reached."""
    leg_s: float
    """Duration of a push."""
    fixed_pushes: Sequence[tuple[float, float, float]] = TO_AND_FRO
    """Pushes of the fixed batch: fx, fy, duration."""
    steer: Callable[[Array, Array, Array], Array] | None = None
    """Computes the force from position, velocity and target, for a puck of known mass. Without it, pushes are adapted
    to the current mass estimate, by the fields from `safe_m` to `coasts_s`."""
    safe_m: float = 3.0
    """Distance from the middle that the puck should not exceed."""
    haste: float = 4.0
    """Largest push per kilogram [m/s²]."""
    slowed: float = 0.7
    """Assumed fraction of the speed that is left after a leg."""
    coasts_s: float = 0.6
    """Assumed time for which the puck coasts after a leg."""
    legs: int = 19
    looks: int = 2
    """Number of readings during each push."""
    lightest_kg: float = 0.3
    heaviest_kg: float = 6.0
    growth: float = 3.0
    """Largest factor by which the mass estimate may grow from leg to leg, which limits the effect of a wrong
    estimate."""
    rim_m: float | None = None
    """Radius of the floor. Readings after the puck has crossed it are not fitted, because the laws do not describe the
    rim."""
    drifts: bool = False
    """Whether pushes compensate an estimated uniform force."""
    idle_legs: int = 0
    """Number of initial legs without a push, which distinguish a uniform force from a small mass."""
    wanders: float = 0.0
    """Standard deviation by which the unknown force per mass changes from reading to reading [m/s²]. With it, pushes
    are planned by `LocalLaw`, and `slowed` and `drifts` are not used. With 0, that force is assumed to be uniform."""
    patience: int | None = None
    """Number of legs after which an unreached target is abandoned, because a force may keep the puck away from it."""

    def solve(self, _: str) -> Protocol:
        """Push gently at first, then back and forth with forces adapted to the estimated mass; then fit every law."""
        seen, place, speed = list[tuple[Call, Any]](), np.zeros(2), np.zeros(2)
        targets, mass, tried = list(self.targets), self.lightest_kg, 0
        for leg in range(self.legs):
            if np.hypot(*(np.array(targets[0]) - place)) < self.near_m or tried == self.patience:
                targets, tried = targets[1:] + targets[:1], 0
            tried += 1
            target = np.array(targets[0])
            if self.steer:
                pushed = self.steer(place, speed, target)
            elif leg < self.idle_legs:
                pushed = np.zeros(2)
            elif self.wanders:
                pushed = self.planned(np.concatenate([place, speed]), target, self.local(seen), mass)
            else:
                pushed = mass * (self.aimed(place, speed, target) - (self.drift(seen) if self.drifts else 0.0))
            calls = self.push(pushed, self.leg_s)
            readings = yield calls
            seen += zip(calls, readings, strict=True)
            place, speed = np.array(readings[-2]["position"][:2]), np.array(readings[-1]["velocity"][:2])
            mass = mass if self.steer or leg < self.idle_legs else min(self.mass(seen), self.growth * mass)
        yield [answer(self.best(seen))]

    def batch(self, _: str) -> Protocol:
        """Push back and forth with fixed forces and durations; then fit every law."""
        calls = [asked for x, y, lasting in self.fixed_pushes for asked in self.push(np.array([x, y]), lasting)]
        readings = yield calls
        yield [answer(self.best(list(zip(calls, readings, strict=True))))]

    def fit(self, readings: Exchanges, structure: str) -> AnswerValue:
        """Return the answer of the best fit of a structure."""
        return self.predict(structure, self.laws.fitted(self.course(readings), structure)[1])

    def best(self, readings: Exchanges) -> AnswerValue:
        """Return the answer of the structure with the best fit."""
        return self.predict(*self.inferred(readings))

    def inferred(self, readings: Exchanges) -> tuple[str, dict[str, float]]:
        """Return the structure with the best fit, and its constants."""
        return self.laws.best(self.course(readings))

    def course(self, readings: Exchanges) -> Course:
        """Return pushes and the readings after them, as long as the puck is on the floor."""
        course = _course(readings)
        if self.rim_m is None:
            return course
        return course.until(np.hypot(course.readings[:, 0], course.readings[:, 1]) > self.rim_m)

    def push(self, newtons: Array, duration: float) -> list[Call]:
        """Return calls that apply a constant push and read at equal intervals."""
        look = round(duration / self.looks / 0.005) * 0.005
        eyes = [call("get_position", object_id=PUCK), call("get_velocity", object_id=PUCK)]
        pushed = call("apply_force", object_id=PUCK, force_vector=[*np.round(newtons, 3).tolist(), 0.0])
        return [pushed, *([call("step", duration=look), *eyes] * self.looks)]

    def mass(self, readings: Exchanges) -> float:
        """Estimate the mass by the linear law. With `wanders`, return the mass that is one standard error less."""
        law = self.local(readings)
        lightness = law.lightness + (law.error if self.wanders else 0.0)
        return float(1 / np.clip(lightness, 1 / self.heaviest_kg, 1 / self.lightest_kg))

    def drift(self, readings: Exchanges) -> Array:
        """Estimate the uniform force per mass by the linear law [m/s²]."""
        return np.clip(self.local(readings).other, -self.haste, self.haste)

    def local(self, readings: Exchanges) -> LocalLaw:
        """Fit the linear law to the readings so far."""
        if not readings:
            return LocalLaw(1 / self.lightest_kg)
        weak = self.lightest_kg if self.wanders else _WEAK_KG
        return LocalLaw.fitted(_course(readings), self.laws.sigma[2], self.wanders, weak)

    def planned(self, state: Array, target: Array, law: LocalLaw, mass: float) -> Array:
        """Return the force that should bring the puck nearest to a target, within the safe radius.

        The puck should stay within that radius even if its mass is one standard error less than estimated.

        Args:
            state: x, y, vx, vy.
            target: x, y.
            law: The law by which the motion is predicted.
            mass: Mass that limits the force [kg].
        """
        pushes = mass * np.vstack([np.zeros(2), self._pushes()]).T
        likely = np.clip(law.lightness, 1 / self.heaviest_kg, 1 / self.lightest_kg)
        now, out = np.zeros((len(state), pushes.shape[1])), np.zeros(pushes.shape[1])
        for lightness in (likely + law.error, likely):
            now = state[:, None] + np.zeros(pushes.shape[1])
            for part in range(2 * _PARTS):
                pushed, lasting = (lightness * pushes, self.leg_s) if part < _PARTS else (0 * pushes, self.coasts_s)
                now = law.followed(now, pushed, lasting / _PARTS)
                out = np.maximum(out, np.hypot(now[0], now[1]) - self.safe_m)
        return pushes[:, np.argmin(np.hypot(now[0] - target[0], now[1] - target[1]) + 10 * out)]

    def aimed(self, place: Array, speed: Array, target: Array) -> Array:
        """Return the push per mass that brings the puck to rest nearest to a target, within the safe radius."""
        pushes = self._pushes()
        after = self.slowed * (speed + self.leg_s * pushes)
        rest = place + self.leg_s * (speed + after) / 2 + self.coasts_s * after
        out = np.maximum(np.hypot(*rest.T) - self.safe_m, 0.0)
        return pushes[np.argmin(np.hypot(*(rest - target).T) + 10 * out)]

    def _pushes(self) -> Array:
        """Return candidate pushes per mass in all directions; shape (n, 2)."""
        angles = np.linspace(0, 2 * np.pi, 25)[:-1]
        ways = np.array([np.cos(angles), np.sin(angles)]).T
        return np.concatenate([size * self.haste * ways for size in _SIZES])


def _course(readings: Exchanges) -> Course:
    """Return pushes and the readings after them."""
    seen = [*(position(PUCK, axis) for axis in AXES), *(velocity(PUCK, axis) for axis in AXES)]
    return recorded(readings, [force(PUCK, axis) for axis in AXES], seen)


def force_on_puck(
    engine: Any, place: tuple[float, float], speed: tuple[float, float] = (0.0, 0.0), time: float = 0.0
) -> Array:
    """Measure the force on the puck at a position, a velocity and a time, in the engine [N].

    A huge inertia keeps position and velocity constant during the time step in which the force is read.
    """
    heavy = heavy_puck(engine)
    heavy.step(heavy.whole_steps(time))
    half = np.array(speed) * heavy.timestep / 2
    heavy.place(PUCK, np.array([*(np.array(place) - half), 0.05]), {})
    heavy.set_velocity(PUCK, np.array([*speed, 0.0]))
    return force_now(heavy)


def heavy_puck(engine: Any, kg: float = HEAVY_KG) -> Any:
    """Return the scene with a puck that keeps its velocity, without `gate`, so that the rim does not catch it."""
    heavy = engine.changed({f"joint[{PUCK}_{axis}].armature": kg for axis in "xy"})
    heavy.place("gate", np.array([0.0, 0.0, 1.0]), {})
    return heavy


def force_now(heavy: Any, kg: float = HEAVY_KG) -> Array:
    """Do one time step, and return the force on a heavy puck during it [N]."""
    before = heavy.twist(PUCK).linear
    heavy.step(1)
    return (heavy.twist(PUCK).linear - before)[:2] * kg / heavy.timestep
