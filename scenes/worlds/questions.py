"""Questions of a world: situations that its laboratory does not allow, the requested quantity, and the answers.

A question starts from the initial state of the apparatus, without a wall. Visible bodies are placed at given positions
and released at a given time. The placement is not part of the history: hidden bodies are unchanged, and the path length
is 0.
"""

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.fitting import Array
from scenes.worlds.equations import moved, rates_of
from scenes.worlds.terms import Structure

Constants = Mapping[str, Array]
"""Values of constants by name, with an entry for each situation that is integrated at the same time."""

REL_TOL, ABS_TOL = 0.05, 0.04
"""Tolerances: a number is right within ABS_TOL + REL_TOL |key|."""
HARDEST = 20.0
"""Upper bound of the search for the force of a `push` question [N, N·m]."""
_GRID = 13
"""Forces from 0 to `HARDEST` between which the answer is bracketed."""
_STEPS = 10
"""Largest number of iterations within a bracket."""
_HELD_S = 0.1
"""Longest integration step while bodies are held [s]; hidden bodies then move smoothly."""
_ROUGH_S = 0.05
"""Integration step from which on linear interpolation between two forces is accurate enough [s]."""


@dataclass(frozen=True, slots=True)
class Question:
    """A situation and a requested number, or a choice between several statements."""

    kind: str
    """`strong`: a force beyond the limit; `far`: a position beyond the wall; `late`: a time after the laboratory's;
    `apart`: the distance of two pucks; `push`: the smallest force that moves a body by a distance; `which`: which of
    several terms acts."""
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


def answers(structure: Structure, constants: Mapping[str, Any], asked: Sequence[Question], longest_s: float) -> Array:
    """Compute the answers by integration.

    Args:
        structure: The terms of the law.
        constants: Numbers, or arrays with a value for each trial.
        asked: The questions.
        longest_s: Longest step of the integration [s].

    Returns:
        Shape (questions, trials), with one trial for plain numbers. NaN if there is no answer.
    """
    trials = int(np.size(constants["m"]))
    own = {name: np.broadcast_to(np.asarray(value, float), (trials,)) for name, value in constants.items()}
    found = np.empty((len(asked), trials))
    for number, question in enumerate(asked):
        if question.options:
            found[number] = option_of(structure, question)
    numbers = [at for at, one in enumerate(asked) if not one.options and one.what != "push"]
    forces = [at for at, one in enumerate(asked) if one.what == "push"]
    with np.errstate(all="ignore"):
        if numbers:
            found[numbers] = _values(structure, own, [asked[at] for at in numbers], longest_s)
        if forces:
            found[forces] = _least_pushes(structure, own, [asked[at] for at in forces], longest_s)
    return found


def option_of(structure: Structure, question: Question) -> float:
    """Return the number of the true option, from 1; NaN if none is true, or several are."""
    forms = {term.form for term in structure.terms}
    found = [number for number, form in enumerate(question.options, 1) if form in forms]
    return float(found[0]) if len(found) == 1 else float("nan")


def _values(structure: Structure, constants: Constants, asked: Sequence[Question], longest_s: float) -> Array:
    """Return the requested numbers after the pushes of all questions, integrated at once; shape (questions, trials)."""
    trials = len(constants["m"])
    pushes = np.repeat([question.push for question in asked], trials, axis=0).T
    return _ended(structure, _tiled(constants, len(asked)), asked, pushes, longest_s)


def _least_pushes(structure: Structure, constants: Constants, asked: Sequence[Question], longest_s: float) -> Array:
    """Return the forces that just move bodies by the distances; NaN unless there is exactly one force.

    Shape (questions, trials).
    """
    trials = len(constants["m"])
    ways = np.repeat([question.push for question in asked], trials, axis=0).T

    def beyond(forces: Array) -> Array:
        """Return by how much the forces move bodies too far; shape (forces, questions × trials)."""
        points = len(forces)
        several, pushes = _tiled(constants, points * len(asked)), np.tile(ways, points) * forces.ravel()
        return _ended(structure, several, [*asked] * points, pushes, longest_s).reshape(forces.shape)

    forces = np.repeat(np.linspace(0, HARDEST, _GRID)[:, None], len(asked) * trials, axis=1)
    found = crossing(beyond, forces, longest_s**4, _STEPS if longest_s < _ROUGH_S else 0)
    return found.reshape(len(asked), trials)


def _tiled(constants: Constants, times: int) -> dict[str, Array]:
    return {name: np.tile(value, times) for name, value in constants.items()}


def _ended(
    structure: Structure, constants: Constants, asked: Sequence[Question], push: Array, longest_s: float
) -> Array:
    """Return the requested numbers of situations that are integrated at once; shape (questions, trials).

    Args:
        structure: The terms of the law.
        constants: A value for each situation; those of one question are next to each other.
        asked: The questions.
        push: Constant forces; shape (controls, situations).
        longest_s: Longest step of the integration [s].
    """
    width, columns = 2 if structure.apparatus.flat else 1, push.shape[1]
    trials = columns // len(asked)
    state = np.zeros((len(structure.states), columns))
    rows = state[: structure.read].reshape(structure.bodies, 2, width, columns)
    rows[:, 0] = np.repeat([one.place for one in asked], trials, axis=0).T.reshape(structure.bodies, width, columns)
    clock = np.repeat([one.clock for one in asked], trials)
    if clock.any() and len(structure.states) > structure.read:
        state[structure.read :] = _held(structure, constants, state[: structure.read], clock)
    rows = state[: structure.read].reshape(structure.bodies, 2, width, columns)
    rows[:, 1] = np.repeat([one.speed for one in asked], trials, axis=0).T.reshape(structure.bodies, width, columns)
    lasting = np.repeat([one.lasting for one in asked], trials)
    seen = moved(rates_of(structure, walled=False), constants, clock, state, push, lasting, longest_s)
    parts = np.split(seen[: structure.read], len(asked), axis=1)
    return np.array([value_of(question, part, width) for question, part in zip(asked, parts, strict=True)])


def _held(structure: Structure, constants: Constants, seen: Array, clock: Array) -> Array:
    """Return the state of hidden bodies and the path length after visible bodies were held in place."""
    kept = [(at, term) for at, term in enumerate(structure.terms) if term.kind.hidden or "wear" in term.modulations]
    alone = Structure(structure.apparatus, tuple(term for _, term in kept), structure.radius)
    names = [*structure.masses, *(name for at, term in kept for name in term.ranges(at))]
    values = np.array([constants[name] for name in names])
    return _held_alone(alone, values.tobytes(), seen.tobytes(), clock.tobytes())


@functools.lru_cache(64)
def _held_alone(alone: Structure, values: bytes, seen: bytes, clock: bytes) -> Array:
    """Do the same for a structure with no other terms. Cached, because many structures share such terms."""
    until = np.frombuffer(clock)
    state = np.zeros((len(alone.states), len(until)))
    state[: alone.read] = np.frombuffer(seen).reshape(alone.read, -1)
    constants = dict(zip(alone.ranges, np.frombuffer(values).reshape(len(alone.ranges), -1), strict=True))
    rates, nothing = rates_of(alone, walled=False, held=True), np.zeros((alone.controls, 1))
    return moved(rates, constants, 0.0, state, nothing, until, _HELD_S)[alone.read :]


def crossing(beyond: Callable[[Array], Array], grid: Array, fine: float, steps: int = _STEPS) -> Array:
    """Find roots of increasing functions by false position. Source: the Illinois algorithm.

    Args:
        beyond: Values at (points, trials), of one function for each trial.
        grid: Ascending points (points, trials) that bracket the roots.
        fine: Absolute value that counts as 0.
        steps: Largest number of iterations within a bracket.

    Returns:
        A root for each trial; NaN unless its function is below 0 at first and changes sign once.
    """
    values = beyond(grid)
    changes = (values[1:] > 0) != (values[:-1] > 0)
    once = (values[0] < 0) & (changes.sum(axis=0) == 1) & np.isfinite(values).all(axis=0)
    trials = np.array(range(grid.shape[1]))
    at: NDArray[np.intp] = changes.argmax(axis=0)
    low, high, below, above = grid[at, trials], grid[at + 1, trials], values[at, trials], values[at + 1, trials]
    side = np.zeros(len(trials))
    point = (low * above - high * below) / (above - below)
    for _ in range(steps):
        value = beyond(point[None])[0]
        if bool((np.abs(value[once]) < fine).all()):
            break
        short = value < 0
        above = np.where(short & (side < 0), above / 2, above)
        below = np.where(~short & (side > 0), below / 2, below)
        low, below = np.where(short, point, low), np.where(short, value, below)
        high, above = np.where(short, high, point), np.where(short, above, value)
        side = np.where(short, -1.0, 1.0)
        point = (low * above - high * below) / (above - below)
    return np.where(once, point, np.nan)


def value_of(question: Question, seen: Array, width: int) -> Array:
    """Return the requested number from the final positions and velocities of each body.

    For a `push` question it is the distance beyond the requested one, along the direction of the push.
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
