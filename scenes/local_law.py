"""A linear law of a puck, fitted to all pushes so far, for planning the next push. Used by reference protocols."""

from dataclasses import dataclass
from typing import Self

import numpy as np

from scenes.course_record import Course
from scenes.fitting import Array, advanced

_LONGEST_S = 0.1


@dataclass(frozen=True, slots=True)
class LocalLaw:
    """A linear law near the present position and time: drag, a force across the velocity, and another force."""

    lightness: float
    """Reciprocal of the mass [1/kg]."""
    error: float = 0.0
    """Standard error of `lightness` [1/kg]."""
    drag: float = 0.0
    """Resisting force per mass and speed [1/s]."""
    turn: float = 0.0
    """Force to the right of the motion per mass and speed [1/s]."""
    other: tuple[float, float] = (0.0, 0.0)
    """Other force per mass at the last reading [m/s²]."""

    @classmethod
    def fitted(cls, course: Course, sigma: float, wanders: float, weak_kg: float) -> Self:
        """Fit the law to pushes and readings of a puck that starts at rest.

        Args:
            course: Forces along x and y, and readings of x, y, vx and vy.
            sigma: Standard deviation of a velocity [m/s].
            wanders: Standard deviation by which the other force changes from reading to reading [m/s²], because it
                depends on place and time; 0 for a uniform force.
            weak_kg: Reciprocal of the standard deviation that `lightness` is assumed to have before any reading [kg].
        """
        durations, after = course.durations, course.readings[:, 2:4]
        before = np.vstack([[0.0, 0.0], after[:-1]])
        (fx, fy), (vx, vy) = course.controls[:, :2].T, (before + after).T / 2
        other = np.tril(np.ones((len(durations), len(durations) if wanders else 1)))  # a constant, then its changes
        other[:, 1:] *= wanders
        none, steps = np.zeros_like(other), other.shape[1]
        rows = np.vstack([np.column_stack([fx, -vx, vy, other, none]), np.column_stack([fy, -vy, -vx, none, other])])
        rows *= np.tile(durations, 2)[:, None] / sigma
        weak = [0.5, *[1.0] * (steps - 1)]
        rows = np.vstack([rows, np.diag([weak_kg, 0.5, 0.5, *weak, *weak])])
        changes = np.concatenate([(after - before).T.ravel() / sigma, np.zeros(rows.shape[1])])
        found = np.linalg.lstsq(rows, changes, rcond=None)[0]
        error = np.sqrt(np.linalg.inv(rows.T @ rows)[0, 0])
        now = (float(other[-1] @ found[3 : 3 + steps]), float(other[-1] @ found[3 + steps :]))
        return cls(float(found[0]), float(error), float(found[1]), float(found[2]), now)

    def followed(self, state: Array, pushes: Array, duration: float) -> Array:
        """Return the states after constant pushes.

        Args:
            state: x, y, vx, vy; shape (4, n).
            pushes: Pushes per mass along x and y [m/s²]; shape (2, n).
            duration: Duration of the pushes [s].
        """

        def rates(_: object, now: Array) -> Array:
            _x, _y, vx, vy = now
            ax = pushes[0] + self.other[0] - self.drag * vx + self.turn * vy
            ay = pushes[1] + self.other[1] - self.drag * vy - self.turn * vx
            return np.array([vx, vy, ax, ay])

        return advanced(rates, 0.0, state, duration, _LONGEST_S)
