"""Fits nonlinear springs to elongations and forces in equilibrium. Used by reference protocols.

An `even` spring pulls with k u, a `cubic` one with k u + c u³, and a `late` one with k u + c max(u - e, 0), where a
second spring engages at the edge e. A law is the tuple (k,), (k, c) or (k, c, e).
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, cast

import numpy as np
from scipy.optimize import least_squares

from scenes.family import member
from scenes.fitting import Array
from scenes.protocol import AnswerValue, Member

Law = tuple[float, ...]
Points = Sequence[tuple[float, float]]
"""Elongations [m] and forces [N] in equilibrium."""
KINDS = ("even", "cubic", "late")
SIGMA_M = 1.5e-4
"""Standard deviation of a position reading [m]."""
SIGMA_RAD_S = 1.5e-3
"""Standard deviation of an angular velocity reading [rad/s]."""
GOALS = (0.06, 0.12, 0.16, 0.19, 0.212, 0.23, 0.246, 0.258, 0.268, 0.277, 0.285, 0.291)
"""Elongations [m] that distinguish the kinds: denser around the edges, up to a catch at 0.3 m."""
_EDGES = np.linspace(0.185, 0.255, 15)
_EDGE_RANGE = (0.18, 0.262)
_LEAST = {"cubic": 3.0, "late": 0.7}
"""Smallest ratio of the second constant to the stiffness; the drawn ones are larger."""
LAST_M = 0.3
"""Elongation at which prompts state the smallest share of a cubic part [m]."""
_RANGES = {"even": [], "cubic": [(0.25, 0.8)], "late": [(0.4, 2.4), (0.18, 0.26)]}
"""Ranges that prompts state: share of the cubic term at `LAST_M`; logarithm of the ratio of the second part's stiffness
to the first one's, which is at least 1.5; and edge [m]."""
_PRICE = 4.0
"""Decrease of chi-square that an additional constant must give."""


def pull(u: Any, k: float, part: float = 0.0, edge: float | None = None) -> Any:
    """Return the pull [N] of a spring at an elongation, or at an array of elongations [m]."""
    return k * u + part * (u**3 if edge is None else np.maximum(u - edge, 0.0))


def energy(u: float, k: float, part: float = 0.0, edge: float | None = None) -> float:
    """Return the energy [J] of a spring at an elongation [m]: the integral of its pull."""
    return k * u**2 / 2 + (part * u**4 / 4 if edge is None else part * max(u - edge, 0.0) ** 2 / 2)


def drawn_kinds(knobs: Mapping[str, Any]) -> str:
    """Return the kinds of all springs, such as `even, late`."""
    return knobs["kinds"]


def drawn(knobs: Mapping[str, Any], number: int) -> tuple[float, ...]:
    """Return the law of spring 1 or 2 from the hidden values `kinds`, k, w, q and s."""
    kind, k = knobs["kinds"].split(", ")[number - 1], knobs[f"k{number}"]
    if kind == "cubic":
        return k, k / knobs[f"w{number}"] ** 2
    return (k,) if kind == "even" else (k, k * knobs[f"q{number}"], knobs[f"s{number}"])


def solved(columns: Sequence[Array], right: Array, size: Array) -> tuple[Array, Array]:
    """Solve a linear least-squares problem; returns misfits in standard deviations, and coefficients of the columns."""
    weighed = np.column_stack(columns) / size[:, None]
    scale = np.linalg.norm(weighed, axis=0) + 1e-12
    found = cast(Array, np.linalg.lstsq(weighed / scale, right / size, rcond=None)[0]) / scale
    return weighed @ found - right / size, found


def best_edge(at: Callable[[float], tuple[Array, Array]], edges: Iterable[float], bounds: tuple[float, float]) -> float:
    """Return the edge with the smallest misfits: the best candidate, refined within bounds.

    Args:
        at: Function of an edge; returns misfits and coefficients.
        edges: Candidate edges.
        bounds: Smallest and largest edge.
    """
    edge = min(edges, key=lambda edge: float((at(edge)[0] ** 2).sum()))
    return float(least_squares(lambda point: at(point[0])[0], [edge], bounds=bounds, diff_step=[1e-4]).x[0])


def spin_errors(spin: Array, torque: Array) -> Array:
    """Return standard deviations of torques [N·m], from the errors of the steady angular velocities [rad/s]."""
    return torque / spin * 2 * SIGMA_RAD_S + 1e-3 * torque


def resisted(columns: Callable[[float], Sequence[Array]], spin: Array, torque: Array) -> tuple[float, Array, float]:
    """Fit a resistance, a part of which begins at an edge; returns chi-square, coefficients and edge.

    Args:
        columns: Function of an edge [rad/s]; returns the basis functions of the torque at the angular velocities.
        spin: Steady angular velocities that were read [rad/s].
        torque: Torques at these angular velocities [N·m].
    """
    size = spin_errors(spin, torque)

    def at(edge: float) -> tuple[Array, Array]:
        return solved(columns(edge), torque, size)

    edge = best_edge(at, np.linspace(5.5, 8.0, 26), (5.3, 8.2))
    misfit, found = at(edge)
    return float((misfit**2).sum()), found, edge


def fitted(points: Sequence[tuple[float, float]], kind: str) -> tuple[float, tuple[float, ...]]:
    """Return chi-square and law of the best spring of a kind through elongations [m] and forces [N]."""
    u, force = np.array(points).T
    slope = np.gradient(force, u + 1e-7 * np.arange(len(u))) if len(u) > 2 else force / u
    size = np.maximum(slope, 0.3 * force / u) * SIGMA_M + 1e-3 * force

    def at(edge: float | None) -> tuple[Array, Array]:
        second = {"even": [], "cubic": [u**3], "late": [np.maximum(u - (edge or 0.0), 0.0)]}[kind]
        return solved([u, *second], force, size)

    edge = best_edge(at, _EDGES, _EDGE_RANGE) if kind == "late" else None
    misfit, found = at(edge)
    cost = float((misfit**2).sum())
    if kind == "even":
        return cost, (float(found[0]),)
    least = _LEAST[kind] * found[0]
    law = float(found[0]), float(max(found[1], least))
    return cost + 1e3 * float(found[1] < least), law if edge is None else (*law, edge)


def best(points: Sequence[tuple[float, float]], alone: float) -> tuple[float, ...]:
    """Return the best-fit law with a penalty per constant; for a single point, an even spring of stiffness `alone`."""
    if len(points) < 2:
        return (alone,)
    fits = [fitted(points, kind) for kind in KINDS]
    return min(fits, key=lambda fit: fit[0] + _PRICE * len(fit[1]))[1]


def next_load(
    rows: Sequence[tuple[float, float]], goals: Sequence[float] = GOALS, near: float = 0.006, least: float = 5e-4
) -> tuple[float, float] | None:
    """Return the next goal, and the force that reaches it by linear extrapolation; None if all are reached.

    Args:
        rows: Elongations [m] and forces [N] so far; the first row is without load.
        goals: Target elongations, ascending.
        near: Distance below a goal within which it counts as reached.
        least: Smallest difference of elongations for which a slope is computed.
    """
    (a, before), (u, now) = rows[-2:]
    goal = next((goal for goal in goals if goal > u + near), None)
    if goal is None:
        return None
    return goal, now + (now - before) / max(u - a, least) * (goal - u)


def stretch(force: Any, k: float, part: float = 0.0, edge: float | None = None) -> Any:
    """Return the elongation [m] for a pull, or for an array of pulls [N]."""
    if edge is not None:
        return force / k - part / k * np.maximum(force - k * edge, 0.0) / (k + part)
    u = force / k
    for _ in range(
        30 if part else 0
    ):  # Newton's method. The law is convex, so the iteration approaches the root from above.
        u = u - (k * u + part * u**3 - force) / (k + 3 * part * u**2)
    return u


@dataclass(frozen=True, slots=True)
class _Fit:
    """A spring of one kind, fitted to elongations.

    Its constants are the logarithm of the stiffness; for a cubic spring also the share of the cubic term in the pull at
    `LAST_M`; for a late spring the logarithm of the ratio of the stiffnesses, and the edge.
    """

    kind: str
    points: Points
    sigma: float

    @property
    def ranges(self) -> list[tuple[float, float]]:
        """Ranges of the constants: that of the stiffness, and the ranges that the prompts state for the others."""
        first = float(np.log(fitted(self.points, self.kind)[1][0]))
        return [(first - 1, first + 1), *_RANGES[self.kind]]

    def law(self, constants: Sequence[float] | Array) -> Law:
        """Convert the constants to a law."""
        k, *more = float(np.exp(constants[0])), *map(float, constants[1:])
        if self.kind == "cubic":
            return k, k * more[0] / (1 - more[0]) / LAST_M**2
        return (k,) if self.kind == "even" else (k, k * float(np.exp(more[0])), more[1])

    def misfits(self, constants: Array) -> Array:
        """Return the misfits of the elongations in standard deviations."""
        u, force = np.array(self.points).T
        return (stretch(force, *self.law(constants)) - u) / self.sigma

    def best(self) -> list[float]:
        """Return the constants that fit best."""
        k, *more = fitted(self.points, self.kind)[1]
        start = [float(np.log(k)), *more]
        if self.kind == "cubic":
            start[1] = 1 - k * LAST_M / float(pull(LAST_M, k, *more))
        elif self.kind == "late":
            start[1] = float(np.log(more[0] / k))
        low, high = np.array(self.ranges).T
        return least_squares(self.misfits, np.clip(start, low, high), bounds=(low, high), x_scale=high - low).x.tolist()


def members(
    springs: Sequence[Points], predict: Callable[[Sequence[Law]], AnswerValue], sigma: float
) -> dict[str, Member]:
    """Fit springs of all kinds to the readings; returns them by their kinds, such as `even, late`.

    Args:
        springs: Elongations and forces of each spring.
        predict: Function of the laws of all springs; returns the answer.
        sigma: Standard deviation of an elongation [m].
    """
    fits = [[(fit := _Fit(kind, points, sigma), fit.best()) for kind in KINDS] for points in springs]
    found: dict[str, Member] = {}
    for chosen in product(*fits):
        parts, sizes = [fit for fit, _ in chosen], np.cumsum([len(best) for _, best in chosen])[:-1]

        def misfits(constants: Array, parts: Sequence[_Fit] = parts, sizes: Any = sizes) -> Array:
            each = zip(parts, np.split(constants, sizes), strict=True)
            return np.concatenate([fit.misfits(own) for fit, own in each])

        def answers(constants: Array, parts: Sequence[_Fit] = parts, sizes: Any = sizes) -> AnswerValue:
            return predict([fit.law(own) for fit, own in zip(parts, np.split(constants, sizes), strict=True)])

        found[", ".join(fit.kind for fit in parts)] = member(
            misfits,
            answers,
            [value for _, best in chosen for value in best],
            [span for fit in parts for span in fit.ranges],
        )
    return found
