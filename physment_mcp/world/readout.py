"""How finely a world is read: the resolution and the seeded noise of its instruments. Knows arrays, and no engine."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from statistics import NormalDist
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Quantity = Literal["position", "velocity", "angle", "spin"]

_NORMAL = NormalDist()
_UNTURNED = np.array([1.0, 0.0, 0.0, 0.0])
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

    def read(self, quantity: Quantity, true: Array, source: str, step: int) -> Array:
        """The reading of a vector.

        Args:
            quantity: What it is.
            true: Its true components (n,), in the unit of the quantity.
            source: What it is read from, such as the name of a body; sets the stream of the noise.
            step: Number of the time step.
        """
        fineness = self.fineness.get(quantity)
        if fineness is None:
            return true
        value = true
        if fineness.noise > 0:
            value = value + fineness.noise * self._noise(quantity, source, step, len(true))
        if fineness.resolution > 0:
            value = _rounded(value, fineness.resolution)
        return value

    def read_number(self, quantity: Quantity, true: float, source: str, step: int) -> float:
        """The reading of a number."""
        return float(self.read(quantity, np.array([true]), source, step)[0])

    def read_quaternion(self, true: Array, source: str, step: int) -> Array:
        """The reading of a unit quaternion (4,): the rotation vector is read as an angle, component by component."""
        fineness = self.fineness.get("angle")
        if fineness is None:
            return true
        if fineness.noise == 0 and not true[1:].any():
            return _UNTURNED.copy()  # as most are, and ten times as fast
        sine = float(np.linalg.norm(true[1:]))
        axis = true[1:] / sine if sine > 0 else np.zeros(3)
        turn = self.read("angle", 2 * np.arctan2(sine, true[0]) * axis, source, step)
        angle = float(np.linalg.norm(turn))
        # sin(angle/2)/angle by numpy's sinc, which is smooth at 0.
        return np.concatenate(([np.cos(angle / 2)], turn * np.sinc(angle / (2 * np.pi)) / 2))

    def read_direction(self, true: Array, source: str, step: int) -> Array:
        """The reading of a unit vector (3,): each component is read as an angle."""
        if "angle" not in self.fineness:
            return true
        read = self.read("angle", true, source, step)
        length = float(np.linalg.norm(read))
        return read / length if length > 0 else true

    def on_grid(self, place: Array) -> Array:
        """The place to which an object is really put: no more finely than positions are read.

        Otherwise a refusal to put it somewhere would measure more finely than the instruments do.
        """
        resolution = self.fineness["position"].resolution if "position" in self.fineness else 0.0
        return _rounded(place, resolution) if resolution > 0 else place

    def _noise(self, quantity: Quantity, source: str, step: int, count: int) -> Array:
        """Standard normal numbers (count,), the same on every machine."""
        digest = hashlib.sha512(f"{self.seed}:{source}:{quantity}:{step}".encode()).digest()
        words = np.frombuffer(digest, dtype=">u8")[:count]
        # The shift by one half keeps the probability off 0 and 1.
        return np.array([_NORMAL.inv_cdf((int(word >> np.uint64(12)) + 0.5) / 2**52) for word in words])


def _rounded(value: Array, resolution: float) -> Array:
    """The nearest multiples of a resolution."""
    # As np.round does it, which takes three times as long for three numbers.
    return np.rint(np.rint(value / resolution) * resolution * _PER_UNIT) / _PER_UNIT


EXACT = Readout()
"""Readout without resolution and noise."""
