"""Computes the motion of the hidden body of a term, given the path of the visible bodies."""

import functools
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from scenes.fitting import Array
from scenes.worlds.equations import hidden_rates_of, rates_of
from scenes.worlds.terms import Structure

_WORD = re.compile(r"[A-Za-z_]\w*")


@dataclass(frozen=True)
class SampledPath:
    """A path of the visible bodies at points of every leg.

    Attributes:
        inner: Number of points of a leg.
        times: Time of each point, and of the end of the last leg [s].
        points: Readable state at these times; shape (states, times).
        between: Readable state at the midpoints between consecutive times; same shape.
    """

    inner: int
    times: Array
    points: Array
    between: Array


def hidden_states(alone: Structure, constants: Mapping[str, Any], trials: int, sampled: SampledPath) -> Array:
    """Return the state of a hidden body at each point of the path that drives it; shape (states, points, trials).

    Args:
        alone: A structure with one term, which has a hidden body.
        constants: Its constants.
        trials: Number of trials.
        sampled: The path.
    """
    names = _constants_of_hidden(alone)
    values = np.array([np.broadcast_to(constants[name], (trials,)) for name in names]).reshape(len(names), trials)
    # Most trials differ only in constants that do not affect the hidden body.
    different, place = np.unique(values, axis=1, return_inverse=True)
    own: dict[str, Any] = dict.fromkeys(alone.ranges, 1.0) | dict(zip(names, different, strict=True))
    found = (_linear if _is_linear(alone) else _step_by_step)(alone, own, different.shape[1], sampled)
    return found[:, :, place.ravel()]


@functools.lru_cache(64)
def _constants_of_hidden(alone: Structure) -> tuple[str, ...]:
    """Return the names of the constants in the equations of the hidden body."""
    words = {word for text in alone.terms[0].hidden_at(0) for word in _WORD.findall(text)}
    return tuple(name for name in alone.ranges if name in words)


def _step_by_step(alone: Structure, constants: Mapping[str, Any], trials: int, sampled: SampledPath) -> Array:
    """Integrate the hidden body of a structure along a path; returns its state at each point."""
    width, rate = (2 if alone.apparatus.flat else 1), hidden_rates_of(alone)(constants, ())
    seen, middles = sampled.points.T.tolist(), sampled.between.T.tolist()
    found = np.zeros((len(sampled.times), 2 * width, trials))

    def change(place: list[float], now: Array) -> Array:
        rates = np.empty_like(now)
        rates[:width] = now[width:]
        for axis, row in enumerate(rate(0.0, [*place, *now]), width):
            rates[axis] = row
        return rates

    for at, h in enumerate(np.diff(sampled.times).tolist()):
        now = found[at]
        a = change(seen[at], now)
        b = change(middles[at], now + h / 2 * a)
        c = change(middles[at], now + h / 2 * b)
        d = change(seen[at + 1], now + h * c)
        found[at + 1] = now + h / 6 * (a + 2 * b + 2 * c + d)
    return found.transpose(1, 0, 2)


def _linear(alone: Structure, constants: Mapping[str, Any], trials: int, sampled: SampledPath) -> Array:
    """Integrate a hidden body with linear equations of motion along a path; returns its state at each point.

    The state after an interval is a linear function of the state before it and of the positions. All legs have equal
    durations, so the matrices of the intervals of one leg apply to every leg.
    """
    size, inner = len(alone.states) - alone.read, sampled.inner
    basis = np.eye(size + 3 * size)
    cases = np.repeat(np.tile(basis, inner), trials, axis=1)
    knobs = {name: np.tile(np.broadcast_to(v, (trials,)), inner * len(basis)) for name, v in constants.items()}
    h = np.repeat(np.diff(sampled.times)[:inner], len(basis) * trials)
    rate, width = hidden_rates_of(alone)(knobs, ()), size // 2
    unread = [0.0] * (alone.read - size)

    def change(place: int, now: Array) -> Array:
        driven = cases[size * (place + 1) : size * (place + 2)]
        return np.vstack([now[width:], *rate(0.0, [*driven, *unread, *now])])

    now = cases[:size]
    a = change(0, now)
    b = change(1, now + h / 2 * a)
    c = change(1, now + h / 2 * b)
    d = change(2, now + h * c)
    maps = (now + h / 6 * (a + 2 * b + 2 * c + d)).reshape(size, inner, len(basis), trials)
    rows = np.concatenate([sampled.points[:size, :-1], sampled.between[:size], sampled.points[:size, 1:]])
    driven = np.einsum("dgst,slg->lgtd", maps[:, :, size:], rows.reshape(3 * size, -1, inner))
    driven = driven.reshape(-1, trials, size, 1)
    matrices = [np.ascontiguousarray(maps[:, gap, :size].transpose(2, 0, 1)) for gap in range(inner)]
    found, state = np.zeros((size, len(sampled.times), trials)), np.zeros((trials, size, 1))
    for at, part in enumerate(driven):
        state = matrices[at % inner] @ state + part
        found[:, at + 1] = state[:, :, 0].T
    return found


@functools.lru_cache(64)
def _is_linear(structure: Structure) -> bool:
    """Return whether the hidden body's equations of motion are linear in the states of both bodies."""
    rng = np.random.default_rng(0)
    one = rng.standard_normal(len(structure.states))
    states = np.column_stack([one, 2 * one, -one])
    knobs = {name: np.full(3, (bounds.low + bounds.high) / 2) for name, bounds in structure.ranges.items()}
    found = rates_of(structure, walled=False)(knobs, np.zeros((structure.controls, 1)))(0.0, states)[structure.read :]
    return bool(np.allclose(found, np.column_stack([found[:, 0], 2 * found[:, 0], -found[:, 0]])))
