"""Formulas of mechanics on plain arrays, in SI units. Independent of the engine and of sessions."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def kinetic_energy(mass: float, velocity: Array) -> float:
    """½ m v² [J]."""
    return 0.5 * mass * float(velocity @ velocity)


def potential_energy(mass: float, gravity: float, height: float) -> float:
    """M g z [J]."""
    return mass * gravity * height


def momentum(mass: float, velocity: Array) -> Array:
    """M v (3,) [kg·m/s]."""
    return mass * velocity


def rotational_energy(inertia: Array, spin: Array) -> float:
    """½ ωᵀ I ω [J], with inertia (3, 3) and spin (3,) in the same frame."""
    return 0.5 * float(spin @ inertia @ spin)


def angular_momentum(inertia: Array, spin: Array) -> Array:
    """I ω (3,) [kg·m²/s], with inertia (3, 3) and spin (3,) in the same frame."""
    return inertia @ spin


def rotation_matrix(quaternion: Array) -> Array:
    """Rotation matrix (3, 3) of a quaternion [w, x, y, z], which is normalised first.

    Raises:
        ValueError: The quaternion is zero.

    Source: Euler-Rodrigues formula.
    """
    largest = float(np.abs(quaternion).max())
    if largest == 0:
        raise ValueError("zero quaternion")
    # Scaling by the largest part first keeps the norm of tiny quaternions from underflowing.
    w, x, y, z = (scaled := quaternion / largest) / np.linalg.norm(scaled)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


def centre_of_mass(masses: Array, centres: Array) -> Array:
    """Mean of centres (n, 3) [m] weighted by masses (n,) [kg]."""
    return masses @ centres / masses.sum()
