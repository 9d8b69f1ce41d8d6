"""How finely a world is read: the resolution and the seeded noise of its instruments. Knows arrays, and no engine."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from statistics import NormalDist
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Quantity = Literal["position", "velocity", "angle", "spin"]

_NORMAL = NormalDist()
_PER_UNIT = 1e12
"""Steps per unit of a rounded reading: the rest is noise of the arithmetic."""


@dataclass(frozen=True, slots=True)
class Fineness:
    """How finely one quantity is read, in its unit."""

    resolution: float = 0.0
    """Readings are multiples of it; 0 for full precision."""
    noise: float = 0.0
    """Standard deviation of the Gaussian noise in each component."""


@dataclass(frozen=True, slots=True)
class Readout:
    """Turns true values into readings. By default a reading is the true value.

    The noise is a function of seed, object, quantity, component and time step. So a second reading at the same moment
    gives the same value, and only readings at different moments can be averaged.
    """

    fineness: Mapping[Quantity, Fineness] = field(default_factory=dict[Quantity, Fineness])
    seed: str = ""
    """Seed of the noise. It must not depend on hidden values."""

    def salted(self, salt: str) -> Self:
        """The same instruments, whose noise depends on a secret text besides."""
        return replace(self, seed=f"{self.seed}:{salt}")

    def is_noisy(self, quantity: Quantity) -> bool:
        """Whether readings of a quantity have noise."""
        return quantity in self.fineness and self.fineness[quantity].noise > 0

    def noise(self, quantity: Quantity, source: str, step: int, count: int) -> Array:
        """The noise (count,) of a reading, in the unit of the quantity; zeros without noise.

        Args:
            quantity: What is read.
            source: What it is read from, such as the name of a body; sets the stream of the noise.
            step: Number of the time step.
            count: Number of components.
        """
        if not self.is_noisy(quantity):
            return np.zeros(count)
        return self.fineness[quantity].noise * self._standard_normal(quantity, source, step, count)

    def resolution(self, quantity: Quantity) -> float:
        """Resolution of a quantity, in its unit; 0 for full precision."""
        return self.fineness[quantity].resolution if quantity in self.fineness else 0.0

    def rounded(self, quantity: Quantity, value: Array) -> Array:
        """A value with its noise, as a multiple of the resolution."""
        resolution = self.resolution(quantity)
        return _rounded(value, resolution) if resolution > 0 else value

    def read_quaternion(self, true: Array, noise: Array) -> Array:
        """The reading of a unit quaternion (4,): its rotation vector is rounded as an angle, component by component.

        Args:
            true: The true orientation.
            noise: A small rotation vector (3,), world axes, by which the reading is turned [rad].
        """
        if "angle" not in self.fineness:
            return true
        turned = true if not noise.any() else _product(quaternion_of(noise), true)
        return quaternion_of(self.rounded("angle", rotation_vector(turned)))

    def read_direction(self, true: Array, noise: Array) -> Array:
        """The reading of a unit vector (3,): each component with its noise is rounded as an angle."""
        if "angle" not in self.fineness:
            return true
        read = self.rounded("angle", true + noise)
        length = float(np.linalg.norm(read))
        return read / length if length > 0 else true

    def on_grid(self, place: Array) -> Array:
        """The place to which an object is really put: no more finely than positions are read.

        Otherwise a refusal to put it somewhere would measure more finely than the instruments do.
        """
        return self.rounded("position", place)

    def _standard_normal(self, quantity: Quantity, source: str, step: int, count: int) -> Array:
        """Standard normal numbers (count,), the same on every machine."""
        digest = hashlib.sha512(f"{self.seed}:{source}:{quantity}:{step}".encode()).digest()
        words = np.frombuffer(digest, dtype=">u8")[:count]
        # The shift by one half keeps the probability off 0 and 1.
        return np.array([_NORMAL.inv_cdf((int(word >> np.uint64(12)) + 0.5) / 2**52) for word in words])


def rotation_vector(quaternion: Array) -> Array:
    """The rotation vector (3,) of a unit quaternion (4,) [rad]."""
    sine = float(np.linalg.norm(quaternion[1:]))
    return np.zeros(3) if sine == 0 else 2 * np.arctan2(sine, quaternion[0]) * (quaternion[1:] / sine)


def quaternion_of(turn: Array) -> Array:
    """The unit quaternion (4,) of a rotation vector (3,) [rad]."""
    angle = float(np.linalg.norm(turn))
    # sin(angle/2)/angle by numpy's sinc, which is smooth at 0.
    return np.concatenate(([np.cos(angle / 2)], turn * np.sinc(angle / (2 * np.pi)) / 2))


def _product(first: Array, second: Array) -> Array:
    """The quaternion (4,) that turns by `second` and then by `first`."""
    scalar = first[0] * second[0] - first[1:] @ second[1:]
    return np.concatenate(([scalar], first[0] * second[1:] + second[0] * first[1:] + np.cross(first[1:], second[1:])))


def _rounded(value: Array, resolution: float) -> Array:
    """The nearest multiples of a resolution."""
    # As np.round does it, which takes three times as long for three numbers.
    return np.rint(np.rint(value / resolution) * resolution * _PER_UNIT) / _PER_UNIT


EXACT = Readout()
"""Readout without resolution and noise."""
