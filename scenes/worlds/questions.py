"""Questions of a world: situations that its laboratory does not allow, and the requested quantity.

A question starts from the initial state of the apparatus, without a wall. Visible bodies are placed at given positions,
held there and released at a given time. The placement itself affects no hidden body and adds nothing to the path
length. Hidden bodies move while the visible bodies are held.
"""

from dataclasses import dataclass

import numpy as np

from scenes.fitting import Array
from scenes.worlds.terms import Structure

REL_TOL, ABS_TOL = 0.05, 0.04
"""Tolerances: a number is right within ABS_TOL + REL_TOL |key|."""


@dataclass(frozen=True, slots=True)
class Question:
    """A situation and a requested number, or a choice between several statements."""

    kind: str
    """`strong`: a force beyond the limit; `far`: a position beyond the wall; `late`: a time after the end of the
    laboratory time; `apart`: the distance of two pucks; `push`: the smallest force that moves a body by a distance;
    `which`: which of several terms acts."""
    place: tuple[float, ...]
    """Initial position of each body [m, rad]."""
    speed: tuple[float, ...]
    """Velocity of each body at its release [m/s, rad/s]."""
    push: tuple[float, ...]
    """Constant force on each body after the release [N, N·m]; for a `push` question its direction."""
    clock: float
    """Time of the release [s]."""
    lasting: float
    """Time between the release and the requested number [s]."""
    what: str
    """The requested number: `dx dy` or `dq`, the change of a coordinate; `vx vy speed` or `u`, of the velocity;
    `apart`, the distance between the pucks; `push`, the force [N, N·m]; `which`, the number of an option."""
    body: int = 1
    """Number of the body."""
    size: float = 0.0
    """Distance by which the body must move along the direction of the push [m, rad]."""
    options: tuple[str, ...] = ()
    """Forms of which exactly one acts."""


def option_of(structure: Structure, question: Question) -> float:
    """Return the number of the true option, from 1; NaN if none is true, or several are."""
    forms = {term.form for term in structure.terms}
    found = [number for number, form in enumerate(question.options, 1) if form in forms]
    return float(found[0]) if len(found) == 1 else float("nan")


def value_of(question: Question, seen: Array, width: int) -> Array:
    """Return the requested number from the final positions and velocities of each body.

    For a `push` question, the number is the distance beyond the requested one, along the direction of the push.
    """
    at = 2 * width * (question.body - 1)
    place, speed = seen[at : at + width], seen[at + width : at + 2 * width]
    begun = question.place[width * (question.body - 1) :]
    axis = 1 if question.what in {"dy", "vy"} else 0
    match question.what:
        case "dx" | "dy" | "dq":
            return place[axis] - begun[axis]
        case "vx" | "vy" | "u":
            return speed[axis]
        case "apart":
            return np.hypot(seen[0] - seen[2 * width], seen[1] - seen[2 * width + 1])
        case "push":
            way = np.array(question.push[at // 2 : at // 2 + width])
            return np.tensordot(way, place, 1) - np.dot(way, begun[:width]) - question.size
        case _:
            return np.sqrt(speed[0] ** 2 + speed[1] ** 2)


def tolerance(key: Array) -> Array:
    """Return the tolerance of an answer."""
    return ABS_TOL + REL_TOL * np.abs(key)
