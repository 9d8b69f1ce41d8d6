"""Fits the resistance of wheels that are driven or braked by loads on pans. Used by reference protocols.

A pan carries one ball at a time. The weight of the ball drives or brakes a wheel. With each ball, the wheel
reaches a steady angular velocity, at which the torques balance. The torques are linear in the coefficients of the
resistance, but not in the *edge*, the angular velocity at which a part of the resistance begins.
"""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from scenes.family import member
from scenes.fitting import Array
from scenes.loads import dense_ball, joined
from scenes.protocol import AnswerValue, Call, Member, Reading, call
from scenes.springs import next_load, resisted, spin_errors

_DENSITY = 1e5
_WAY_M = 0.1
"""Distance along x between balls with even numbers and balls with odd numbers."""
_NEAR, _LEAST = 0.4, 1e-2
"""Tolerance below a target angular velocity; smallest difference of angular velocities for a slope [rad/s]."""
_STEEPEST, _EVENEST = 80.0, 1.05
"""Largest and smallest ratio of a load to the previous one."""
_ROOM = 3.0
"""Upper bound of a coefficient, as a multiple of the value at which its part alone gives the largest torque."""


@dataclass(frozen=True, slots=True)
class LoadedPan:
    """A pan that carries one ball; each new ball replaces the previous one."""

    body: str
    x_m: float
    """Position of the pan along x."""
    wheel: str = "object_1"
    """The wheel whose angular velocity is read."""
    wait_s: float = 9.0
    """Time for the wheel to reach a steady angular velocity."""
    letter: str = "b"
    height_m: float = 1.0

    def put(self, number: int, kg: float) -> list[Call]:
        """Return calls that replace the ball on the pan by ball `number`."""
        place = [self.x_m + _WAY_M * (number % 2), 0.0, self.height_m]
        old = [call("delete_objects", object_id=f"{self.letter}{number - 1}")] if number else []
        return [*joined(dense_ball(f"{self.letter}{number}", kg, place, _DENSITY), self.body), *old]

    def look(self, wait_s: float | None = None) -> list[Call]:
        """Return calls that wait and read the angular velocity."""
        return [call("step", duration=wait_s or self.wait_s), call("get_velocity", object_id=self.wheel)]

    def load(self, number: int, kg: float) -> list[Call]:
        """Return calls that replace the ball on the pan by ball `number`, wait, and read the angular velocity."""
        return [*self.put(number, kg), *self.look()]

    def turned(
        self, number: int, kg: float, first: Sequence[Call], goals: Sequence[Sequence[float]], enough: float
    ) -> Generator[list[Call], list[Reading], tuple[list[tuple[Call, Reading]], list[tuple[float, float]]]]:
        """Turn the wheel at increasing angular velocities; each ball's mass is computed from the previous results.

        Args:
            number: Number of the first ball, which becomes part of its name.
            kg: Mass of the first ball [kg].
            first: Calls to make before the first ball is loaded.
            goals: For each ball, candidate target angular velocities of the next ball, ascending [rad/s]; the lowest
                one that the wheel has not reached is chosen.
            enough: Angular velocity above which no further ball is loaded [rad/s].

        Returns:
            The calls with their readings; and for each ball the angular velocity [rad/s] and the mass [kg], after a
            first pair (0, 0) for the wheel at rest.
        """
        seen, rows, calls = list[tuple[Call, Reading]](), [(0.0, 0.0)], list(first)
        for ahead in goals:
            calls += self.load(number, kg)
            readings = yield calls
            seen += zip(calls, readings, strict=True)
            rows.append((readings[-1]["angular_velocity"], kg))
            wanted = next_load(rows, ahead, _NEAR, _LEAST)
            if wanted is None or rows[-1][0] > enough:
                break
            number, calls = number + 1, []
            kg = min(max(wanted[1], _EVENEST * kg), _STEEPEST * kg)
        return seen, rows


def resisted_member(
    columns: Callable[[float], Sequence[Array]],
    spin: Array,
    torque: Array,
    predict: Callable[[Array, float], AnswerValue],
    edges: tuple[float, float],
) -> Member:
    """Fit a law of resistance with nonnegative coefficients; returns it as a member of the family of possible laws.

    Args:
        columns: Function of an edge [rad/s]; returns the basis functions of the torque at the angular velocities.
        spin: Steady angular velocities that were read [rad/s].
        torque: Torques at these angular velocities [N·m].
        predict: Function of the coefficients and the edge; returns the answer.
        edges: Smallest and largest edge.
    """
    error = spin_errors(spin, torque)
    units = [float(torque.max() / max(part.max(), 1e-9)) for part in columns(edges[0])]

    def misfits(constants: Array) -> Array:
        parts = (
            factor * unit * part for factor, unit, part in zip(constants, units, columns(constants[-1]), strict=False)
        )
        return np.asarray((sum(parts) - torque) / error, dtype=float)

    _, found, edge = resisted(columns, spin, torque)
    ranges = [*[(0.0, _ROOM)] * len(units), edges]
    low, high = np.array(ranges).T
    start = np.clip([*(found / units), edge], low + 1e-3, high - 1e-3)
    best = least_squares(misfits, start, bounds=(low, high), x_scale=high - low, xtol=1e-12, ftol=1e-12).x
    return member(misfits, lambda constants: predict(constants[:-1] * units, float(constants[-1])), best, ranges)


def left_spin(engine: Any, body: str, wheel: str, torques: Sequence[float], asked: float, seconds: float) -> float:
    """Return the relative error of a wheel's angular velocity after several torques that act one after the other.

    Args:
        engine: The engine without brakes.
        body: The body on which the torque acts.
        wheel: The body whose angular velocity is read.
        torques: Torques, one after the other: for example a disturbed one, then that of the question [N·m].
        asked: The angular velocity of the question [rad/s].
        seconds: Duration of each torque [s].
    """
    for torque in torques:
        engine.push(body, torque=np.array([0.0, 0.0, torque]))
        engine.step(engine.whole_steps(seconds))
    return float(engine.turn(wheel).spin) / asked - 1
