"""Computes the answers to the questions of a world by integrating the equations of motion of its law.

All situations of all questions, trial constants and forces are integrated at once, because a step takes as long for one
as for hundreds.
"""

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from scenes.fitting import Array
from scenes.worlds.equations import moved, rates_of, switch_of
from scenes.worlds.law_texts import ODO_RATE
from scenes.worlds.questions import Question, option_of, value_of
from scenes.worlds.terms import Structure

Constants = Mapping[str, Array]
"""Values of constants by name, with an entry for each situation that is integrated at the same time."""

HARDEST = 20.0
"""Upper bound of the search for the force of a `push` question [N, N·m]."""
_GRID = 13
"""Number of forces from 0 to `HARDEST` between which the answer is bracketed."""
_STEPS = 10
"""Largest number of iterations within a bracket."""
_HELD_S = 0.1
"""Longest integration step while bodies are held [s]; hidden bodies then move smoothly."""
_ROOT_S = 0.06
"""Integration step above which linear interpolation between two forces is accurate enough [s]."""
_ROUGH_S = 0.05
"""Integration step with which a force is first found if it is needed precisely [s]."""
_FINE_S = 0.02
"""Integration step below which a force is first found with steps of `_ROUGH_S` [s]."""
_LEAST_SPEED = 1e-3
"""Speed at which the path length of a body at rest grows [m/s, rad/s]."""
_BESIDE = 1e-3
"""Relative distance of the two forces that bracket the answer from the roughly computed force."""


def answers(structure: Structure, constants: Mapping[str, Any], asked: Sequence[Question], longest_s: float) -> Array:
    """Compute the answers.

    Args:
        structure: The terms of the law.
        constants: Numbers, or arrays with a value for each trial.
        asked: The questions.
        longest_s: Longest step of the integration [s].

    Returns:
        Shape (questions, trials), with one trial for plain numbers. NaN if there is no answer.
    """
    own, trials = _by_trial(constants)
    with np.errstate(all="ignore"):
        return _answers(structure, own, trials, asked, longest_s)


def answers_without_parts(
    structure: Structure, constants: Mapping[str, float], asked: Sequence[Question], longest_s: float
) -> Array:
    """Compute the answers by the law, and by the law without each of its parts; other constants stay the same.

    Returns:
        Shape (questions, 1 + parts).
    """
    acts: dict[str, Any] = {
        switch_of(part): np.arange(len(structure.parts) + 1) != number for number, part in enumerate(structure.parts, 1)
    }
    own, trials = _by_trial({**constants, **acts})
    with np.errstate(all="ignore"):
        found = _answers(structure, own, trials, asked, longest_s, switched=True)
    for number, question in enumerate(asked):
        for column, (at, modulation) in enumerate(structure.parts, 1):
            if modulation is None and structure.terms[at].form in question.options:
                found[number, column] = np.nan
    return found


def gradients(
    structure: Structure, constants: Mapping[str, Array], shift: float, asked: Sequence[Question], longest_s: float
) -> tuple[Array, Array]:
    """Compute the answers and their derivatives.

    Args:
        structure: The terms of the law.
        constants: The first trial is the point; in each other trial, one coordinate is larger by `shift`.
        shift: The increment of each coordinate.
        asked: The questions.
        longest_s: Longest step of the integration [s].

    Returns:
        The answers, shape (questions,), and their derivatives, shape (questions, coordinates).
    """
    own, trials = _by_trial(constants)
    found = answers(structure, {name: value[:1] for name, value in own.items()}, asked, longest_s)[:, 0]
    slopes = np.zeros((len(asked), trials - 1))
    numbers = [at for at, one in enumerate(asked) if not one.options]
    pushed = np.array([asked[at].what == "push" for at in numbers])
    # The last trial has a larger force instead, for the derivative of a root by the implicit function theorem.
    forces = np.where(pushed, found[numbers], 1.0)
    more = np.where(pushed, forces + shift, 1.0)
    sizes = np.column_stack([np.repeat(forces[:, None], trials, axis=1), more]).ravel()
    several = {name: np.append(value, value[:1]) for name, value in own.items()}
    push = np.repeat([asked[at].push for at in numbers], trials + 1, axis=0).T * sizes
    with np.errstate(all="ignore"):
        ends = _ended(structure, _tiled(several, len(numbers)), [asked[at] for at in numbers], push, longest_s)
        changes = (ends[:, 1:] - ends[:, :1]) / shift
        slopes[numbers] = np.where(pushed[:, None], -changes[:, :-1] / changes[:, -1:], changes[:, :-1])
    return found, slopes


def _by_trial(constants: Mapping[str, Any]) -> tuple[dict[str, Array], int]:
    """Return constants as arrays, and the number of trials."""
    trials = max(int(np.size(value)) for value in constants.values())
    return {name: np.broadcast_to(np.asarray(value), (trials,)) for name, value in constants.items()}, trials


def _answers(
    structure: Structure,
    constants: Constants,
    trials: int,
    asked: Sequence[Question],
    longest_s: float,
    *,
    switched: bool = False,
) -> Array:
    found = np.empty((len(asked), trials))
    for number, question in enumerate(asked):
        if question.options:
            found[number] = option_of(structure, question)
    numbers = [at for at, one in enumerate(asked) if not one.options and one.what != "push"]
    forces = [at for at, one in enumerate(asked) if one.what == "push"]
    if not numbers and not forces:
        return found
    pushed = [asked[at] for at in forces]
    ways = np.repeat([one.push for one in pushed], trials, axis=0).T

    def ended(plain: Sequence[Question], points: Array, step: float) -> Array:
        """Evaluate the questions, with the force of each `push` question replaced by trial forces.

        Args:
            plain: The questions.
            points: Trial forces; shape (points, `push` questions × trials).
            step: Longest step of the integration [s].

        Returns:
            The requested numbers, and for each trial force the distance beyond the requested one.
        """
        push = [np.repeat([one.push for one in plain], trials, axis=0).T] if plain else []
        push += [np.tile(ways, len(points)) * points.ravel()] if pushed else []
        several = [*plain, *pushed * len(points)]
        own = _tiled(constants, len(several))
        return _ended(structure, own, several, np.hstack(push), step, switched=switched)

    def beyond(points: Array, step: float = longest_s) -> Array:
        return ended((), points, step).reshape(points.shape)

    grid = np.repeat(np.linspace(0, HARDEST, _GRID)[:, None], len(pushed) * trials, axis=1)
    if pushed and longest_s < _FINE_S:
        rough = crossing(lambda points: beyond(points, _ROUGH_S), grid, beyond(grid, _ROUGH_S), _ROUGH_S**4)
        near = np.where(np.isnan(rough), HARDEST, rough)
        grid = np.sort(np.vstack([grid, near * (1 - _BESIDE), near * (1 + _BESIDE)]), axis=0)
    ends = ended([asked[at] for at in numbers], grid, longest_s)
    found[numbers] = ends[: len(numbers)]
    if pushed:
        values = ends[len(numbers) :].reshape(grid.shape)
        root = crossing(beyond, grid, values, longest_s**4, _STEPS if longest_s <= _ROOT_S else 0)
        found[forces] = root.reshape(len(forces), trials)
    return found


def _tiled(constants: Constants, times: int) -> dict[str, Array]:
    return {name: np.tile(value, times) for name, value in constants.items()}


def _ended(
    structure: Structure,
    constants: Constants,
    asked: Sequence[Question],
    push: Array,
    longest_s: float,
    *,
    switched: bool = False,
) -> Array:
    """Return the requested numbers of situations that are integrated at once; shape (questions, trials).

    Args:
        structure: The terms of the law.
        constants: A value for each situation; the situations of a question are adjacent.
        asked: The questions.
        push: Constant forces; shape (controls, situations).
        longest_s: Longest step of the integration [s].
        switched: Whether additional constants switch the parts on and off.
    """
    width, columns = 2 if structure.apparatus.flat else 1, push.shape[1]
    trials = columns // len(asked)
    state = np.zeros((len(structure.states), columns))
    rows = state[: structure.read].reshape(structure.bodies, 2, width, columns)
    rows[:, 0] = np.repeat([one.place for one in asked], trials, axis=0).T.reshape(structure.bodies, width, columns)
    clock = np.repeat([one.clock for one in asked], trials)
    if clock.any() and len(structure.states) > structure.read:
        late = np.flatnonzero(clock)
        own = {name: value[late] for name, value in constants.items()}
        state[structure.read :, late] = _held(structure, own, state[: structure.read, late], clock[late])
    rows[:, 1] = np.repeat([one.speed for one in asked], trials, axis=0).T.reshape(structure.bodies, width, columns)
    lasting = np.repeat([one.lasting for one in asked], trials)
    rates = rates_of(structure, walled=False, switched=switched)
    seen = moved(rates, constants, clock, state, push, lasting, longest_s)
    parts = np.split(seen[: structure.read], len(asked), axis=1)
    return np.array([value_of(question, part, width) for question, part in zip(asked, parts, strict=True)])


def _held(structure: Structure, constants: Constants, seen: Array, clock: Array) -> Array:
    """Return the state of hidden bodies and the path length after visible bodies were held in place."""
    found = np.zeros((len(structure.states) - structure.read, len(clock)))
    if structure.worn:
        speed = -_LEAST_SPEED * np.expm1(-ODO_RATE * clock)
        found[-2:] = _LEAST_SPEED * clock - speed / ODO_RATE, speed
    kept = [(at, term) for at, term in enumerate(structure.terms) if term.kind.hidden]
    if kept:
        alone = Structure(structure.apparatus, tuple(term.plain for _, term in kept), structure.radius)
        names = [*structure.masses, *(name for at, term in kept for name in term.plain.ranges(at))]
        values = np.array([constants[name] for name in names])
        # Many situations differ only in quantities that do not act on the hidden body, such as the force.
        different, place = np.unique(np.vstack([values, seen, clock]), axis=1, return_inverse=True)
        moved_there = _held_alone(alone, different.tobytes(), different.shape[1])
        found[: len(moved_there)] = moved_there[:, place.ravel()]
    return found


@functools.lru_cache(64)
def _held_alone(alone: Structure, given: bytes, columns: int) -> Array:
    """Compute the state of hidden bodies for a structure that has only terms with hidden bodies.

    The result is cached, because many structures share such terms.

    Args:
        alone: The terms with hidden bodies.
        given: Constants, readable states and times, in rows.
        columns: Number of situations.
    """
    rows = np.frombuffer(given).reshape(-1, columns)
    constants = dict(zip(alone.ranges, rows, strict=False))
    seen, until = rows[len(alone.ranges) : -1], rows[-1]
    state = np.vstack([seen, np.zeros((len(alone.states) - alone.read, columns))])
    rates, nothing = rates_of(alone, walled=False, held=True), np.zeros((alone.controls, 1))
    return moved(rates, constants, 0.0, state, nothing, until, _HELD_S)[alone.read :]


def crossing(beyond: Callable[[Array], Array], grid: Array, values: Array, fine: float, steps: int = _STEPS) -> Array:
    """Find roots of increasing functions by false position. Source: the Illinois algorithm.

    Args:
        beyond: Takes points (points, trials) and returns the values there. Each trial has a function of its own.
        grid: Ascending points (points, trials) that bracket the roots.
        values: The values at the points of `grid`.
        fine: Absolute value that counts as 0.
        steps: Largest number of iterations within a bracket.

    Returns:
        A root for each trial; NaN unless its function is below 0 at first and changes sign once.
    """
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
