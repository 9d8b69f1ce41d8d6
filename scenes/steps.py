"""Loads a body step by step, reads it at rest, and fits the restoring forces. Used by reference protocols."""

from collections.abc import Callable, Generator, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from scenes.fitting import Array
from scenes.protocol import Call, Exchanges, Reading, call

_REST_S = 1.0
"""After a longer step the body is assumed to be at rest; shorter steps observe its motion [s]."""
_STEP_M = 1e-5
_WRONG = 1e4
"""Penalty of a negative stiffness, because springs and floats only push back."""
_FEW, _MANY = 25, 60
"""Largest number of iterations of a fit from each starting point, and of the final fit from the best one."""
_ALWAYS, _EACH = 3, 3
"""Number of constants of the permanent support, and of each part that engages later."""


@dataclass(frozen=True, slots=True)
class PushSteps:
    """Forces that grow in steps, small enough not to trigger a device that releases a fast or distant body."""

    bodies: Sequence[str]
    """The pushed body, then the other bodies that are read."""
    top_m: float
    """Height of the body at the start."""
    deepest: float
    """Largest allowed deflection [m]."""
    enough: float
    """Deflection at which loading ends [m]."""
    fastest: float
    """Largest allowed speed [m/s]."""
    share: float
    """Share of `fastest` that the speed should reach in the next step."""
    room: float
    """One step is made at a time if the deflection left is smaller than this many times the one gained last."""
    first_n: float
    """First step [N]."""
    most: int
    """Largest number of steps."""
    singly: int
    """Number of steps that are made and observed one at a time; later ones are made two at a time."""
    look_s: float
    """Time at which the speed is read in an observed step [s]."""
    wait_s: float
    """Time for the body to come to rest [s]."""
    least_m: float
    """Value that replaces a smaller displacement of a step, because noise would make the next step too large [m]."""
    least_m_s: float
    """Value that replaces a smaller speed, for the same reason [m/s]."""

    def push(self, newtons: float) -> Call:
        """Return the call that pushes the body down."""
        return call("apply_force", object_id=self.bodies[0], force_vector=[0, 0, -float(f"{newtons:.5g}")])

    def rest(self) -> list[Call]:
        """Return calls that read all positions at rest."""
        reads = (call("get_position", object_id=body) for body in self.bodies)
        return [call("step", duration=self.wait_s), *reads]

    def pushed(self) -> Generator[list[Call], list[Reading], list[tuple[Call, Reading]]]:
        """Increase the force until the displacement is large enough; returns the exchanges."""
        seen, force, more, number, way = list[tuple[Call, Reading]](), 0.0, self.first_n, 0, 0.0
        allowed, gained = np.inf, 0.0
        while number < self.most and way < self.enough:
            single = number < self.singly or self.deepest - way < self.room * gained
            before, calls, count = way, list[Call](), 1 if single else 2
            watch = [call("step", duration=self.look_s), call("get_velocity", object_id=self.bodies[0])]
            for _ in range(count):
                force += more
                calls += [self.push(force), *(watch if number < self.singly else []), *self.rest()]
            readings = yield calls
            seen += zip(calls, readings, strict=True)
            way = self.rows(seen)[-1][1]
            if number < self.singly:
                allowed = self.share * self.fastest * more / max(-readings[2]["velocity"][2], self.least_m_s)
            number += count
            gained = max((way - before) / count, self.least_m)
            more = min(8 * more, allowed, 0.75 * more * max(self.deepest - way, self.least_m) / gained)
        return seen

    def rows(self, exchanges: Exchanges) -> list[tuple[float, ...]]:
        """Return force [N], deflection and heights of the other bodies [m] for each equilibrium.

        The list stops before the first deflection beyond `deepest`.
        """
        force, last, found, rows = 0.0, 0.0, list[float](), list[tuple[float, ...]]()
        for asked, reading in exchanges:
            if asked.tool == "apply_force":
                force = -asked.arguments["force_vector"][2]
            elif asked.tool == "step":
                last, found = asked.arguments["duration"], []
            elif asked.tool == "get_position" and last > _REST_S:
                height = reading["position"][2]
                found.append(height if found else self.top_m - height)
                if found[0] > self.deepest:
                    break
                if len(found) == len(self.bodies):
                    rows.append((force, *found))
        return rows


def fitted_strengths(
    columns: Callable[[Array], Array], places: Array, forces: Array, sigma: float, rounds: int
) -> tuple[float, Array]:
    """Fit the strengths of restoring forces to exact forces and inexact positions; returns chi-square and strengths.

    Args:
        columns: Function of positions (n,); returns restoring forces of unit strength, shape (n, strengths).
        places: Positions of the body at rest [m].
        forces: Forces applied there [N].
        sigma: Standard deviation of a position [m].
        rounds: Number of updates of the slope that converts errors of positions into errors of forces.
    """
    table, ahead = columns(places), columns(places + _STEP_M)
    slope = np.full(len(places), float(forces @ places / (places @ places)))
    error, strengths = sigma * slope, np.zeros(table.shape[1])
    for _ in range(rounds):
        error = sigma * slope
        strengths = np.asarray(np.linalg.lstsq(table / error[:, None], forces / error, rcond=None)[0], dtype=float)
        slope = np.maximum((ahead - table) @ strengths / _STEP_M, 0.1 * np.max(slope))
    misfit = float((((table @ strengths - forces) / error) ** 2).sum())
    return misfit + _WRONG * float(min(strengths) < 0), strengths


def held_down(engine: Any, body: str, stiffness: float, asked_m: float, top_m: float) -> float:
    """Return the force that holds a body at a distance below its start in the engine, with a blocked device [N]."""
    hand, goal, down = 100 * stiffness, asked_m, 0.0
    free = engine.changed({"joint[device_joint].damping": 1e9, f"joint[{body}_joint].stiffness": hand})
    while abs(down - asked_m) > 1e-6:
        goal += asked_m - down if down else 0.0
        free.push(body, force=np.array([0.0, 0.0, -hand * goal]))
        free.step(free.whole_steps(2.0))
        down = top_m - float(free.pose(body).position[2])
    return hand * (goal - down)


def fitted_from(
    misfits: Callable[[Array], Array],
    starts: Iterable[Sequence[float]],
    bounds: tuple[Any, Any],
    sizes: Sequence[float],
) -> tuple[float, Array]:
    """Run least squares from several starting points, the best one to convergence; returns chi-square and constants.

    Args:
        misfits: Function of the constants; returns the misfits in standard deviations.
        starts: Starting points.
        bounds: Smallest and largest values of the constants.
        sizes: Typical sizes of the constants.
    """
    tries = [least_squares(misfits, start, bounds=bounds, x_scale=sizes, max_nfev=_FEW) for start in starts]
    first = min(tries, key=lambda found: found.cost)
    best = least_squares(misfits, first.x, bounds=bounds, x_scale=sizes, max_nfev=_MANY)
    return 2 * float(best.cost), best.x


@dataclass(frozen=True, slots=True)
class LateParts:
    """Supports that act on a body only beyond a gap: props at a distance, cords with slack.

    The constants are first the three of the permanent support (the matrix of a linear law of two loads), and then the
    position, the stiffness and the gap of each late support.
    """

    pressed: Callable[[Array, Array], Array]
    """Computes the deformation of a late support at each point, from its three constants and the points."""
    least: float
    """Smallest deformation that determines the stiffness of a late support [m, rad]."""
    times: int
    """Number of points at which this deformation must be reached."""

    def known(self, constants: Array, points: Array) -> Array:
        """Return the constants without the stiffnesses of late supports that are still unknown."""
        known = np.array(constants, dtype=float)
        for part in known[_ALWAYS:].reshape(-1, _EACH):
            if np.sum(self.pressed(part, points) > self.least) < self.times:
                part[1] = 0.0
        return known

    def approached(
        self,
        seen: list[tuple[Call, Reading]],
        rounds: Iterable[tuple[float, Iterable[Any]]],
        first: Array,
        calls: Callable[[str, Array, float, Any], list[Call]],
        fit: Callable[[Exchanges], tuple[str, Array, Array]],
    ) -> Generator[list[Call], list[Reading], tuple[str, Array]]:
        """Load the body according to the current fit; each round gives more weight to the fitted late supports.

        Args:
            seen: Exchanges so far; those of the rounds are appended.
            rounds: Weight of late supports, from 0 to 1, and target, for each round.
            first: Constants of the permanent support.
            calls: Function of the structure (empty in the first round), the known constants, the weight and the target;
                returns the calls.
            fit: Function of all exchanges; returns the best-fit structure, its constants, and the points.

        Returns:
            The final best-fit structure and its constants.
        """
        structure, constants, known = "", first, first
        for trust, aims in rounds:
            asked = [one for aim in aims for one in calls(structure, known, trust, aim)]
            seen += zip(asked, (yield asked), strict=True)
            structure, constants, points = fit(seen)
            known = self.known(constants, points)
        return structure, constants
