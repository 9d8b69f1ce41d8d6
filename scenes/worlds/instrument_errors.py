"""The systematic error of the position instrument of a world: a bias and a drift per coordinate.

The prompt says that there is an error, and states its bounds. One instrument reads all bodies, so they share the error:
it is the *bias* at time 0 and changes uniformly with the laboratory's clock by the *drift*, as if a camera whose mount
is displaced and creeps read the positions.

Positions have the error, and velocities have none:

- It can be inferred without the law. The first reading at the known start gives the bias; the displacement between two
  readings minus the integral of the read velocity gives the drift.
- It matters. Positions are the more precise readings, and without them the forces that depend on the place are
  unknown. The certificate *instrument* tests that an answer is wrong if a fit neglects the bias or the drift. An error
  of velocities did not pass this test: positions determine the velocities anyway, so a fit that neglects a bias of
  1 m/s and a drift of 0.1 m/s² gave right answers in 8 of 10 worlds of level 2.
- One reading at rest does not remove it, because of the drift: no position after the start is known.

A fit treats the errors as nuisance constants with a normal prior, whose standard deviation is the stated bound.
Readings are linear in them, so they are eliminated in closed form: misfits are whitened with their covariance.
"""

import random
from collections.abc import Mapping
from typing import cast

import numpy as np

from scenes.fitting import Array

LEAST = 0.5
"""Smallest drawn error, as a share of the stated bound."""
_ONE = ("instrument_bias", "instrument_drift")
_TWO = ("instrument_bias_x", "instrument_bias_y", "instrument_drift_x", "instrument_drift_y")
_NAMES = {1: _ONE, 2: _TWO}
"""Number of coordinates of a body → names of the errors: biases [m, rad], then drifts [m/s, rad/s]."""


def error_names(width: int) -> tuple[str, ...]:
    """Return the names of the errors of one or two coordinates: biases, then drifts."""
    return _NAMES[width]


def draw_errors(width: int, bias: float, drift: float, rng: random.Random) -> dict[str, float]:
    """Sample the error of each coordinate, between `LEAST` and 1 times its bound and of either sign."""
    bounds = [bias] * width + [drift] * width
    sizes = [rng.choice((-1, 1)) * bound * rng.uniform(LEAST, 1) + 0.0 for bound in bounds]
    return {name: float(f"{size:.6g}") for name, size in zip(error_names(width), sizes, strict=True)}


def stated_errors(constants: Mapping[str, float], quantity: str, width: int) -> dict[str, dict[str, list[float]]]:
    """Return the errors in the form of the model's text element. Errors of an angle are rotations about the z axis."""
    values = [constants[name] for name in error_names(width)]
    parts = {"bias": values[:width], "drift": values[width:]}
    axes = slice(2, 3) if quantity == "angle" else slice(0, width)
    found = {part: [0.0, 0.0, 0.0] for part in parts}
    for part, numbers in parts.items():
        found[part][axes] = numbers
    return {quantity: found}


def error_columns(times: Array, bodies: int, width: int) -> Array:
    """Return the derivative of each reading with respect to each error; shape (times, readings, errors)."""
    found = np.zeros((len(times), bodies, 2, width, 2 * width))
    for axis in range(width):
        found[:, :, 0, axis, axis] = 1.0
        found[:, :, 0, axis, width + axis] = times[:, None]
    return found.reshape(len(times), 2 * bodies * width, 2 * width)


def whitened(misfits: Array, spread: Array) -> Array:
    """Remove from misfits the part that systematic errors explain. Their other errors are independent, of variance 1.

    The sum of the squared results is the smallest sum of squares that any values of the systematic errors give: of the
    remaining misfits and of these errors, each in standard deviations.

    Args:
        misfits: Misfit of each reading [standard deviations]; a column for each trial.
        spread: Change of each misfit by one standard deviation of each error; shape (readings, errors).
    """
    basis, sizes, _ = np.linalg.svd(spread, full_matrices=False)
    shares = 1 - 1 / np.hypot(1, sizes)
    return misfits - basis @ (shares[:, None] * (basis.T @ misfits))


def kinematic_errors(places: Array, speeds: Array, durations: Array, spread: Array) -> Array:
    """Estimate the errors from displacements and read velocities alone, by the trapezoidal rule.

    Args:
        places: Positions at the start, where they are exact, and at each reading; shape (1 + readings, coordinates).
        speeds: Velocities at the same times.
        durations: Time between readings [s].
        spread: Change of each later position by each error; shape (readings, coordinates, errors).
    """
    excess = np.diff(places, axis=0) - (speeds[1:] + speeds[:-1]) / 2 * durations[:, None]
    growth = np.diff(np.concatenate([np.zeros_like(spread[:1]), spread]), axis=0)
    return cast(Array, np.linalg.lstsq(growth.reshape(-1, growth.shape[2]), excess.ravel(), rcond=None)[0])
