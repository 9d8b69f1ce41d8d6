"""Formulas, compared with values computed by hand."""

import numpy as np
import pytest

from physment_mcp import mechanics


def test_formulas_give_what_the_textbook_gives() -> None:
    velocity = np.array([3.0, 0.0, 4.0])
    inertia, spin = np.diag([1.0, 2.0, 3.0]), np.array([1.0, 1.0, 2.0])
    assert mechanics.kinetic_energy(2.0, velocity) == 25.0
    assert mechanics.potential_energy(2.0, 9.81, 3.0) == pytest.approx(58.86, rel=1e-15)
    assert mechanics.momentum(2.0, velocity).tolist() == [6.0, 0.0, 8.0]
    assert mechanics.rotational_energy(inertia, spin) == 7.5
    assert mechanics.angular_momentum(inertia, spin).tolist() == [1.0, 2.0, 6.0]
    centre = mechanics.centre_of_mass(np.array([1.0, 3.0]), np.array([[0.0, 0.0, 0.0], [4.0, 0.0, 8.0]]))
    assert centre.tolist() == [3.0, 0.0, 6.0]


def test_the_length_of_a_quaternion_does_not_matter_and_zero_is_refused() -> None:
    quarter = np.array([1.0, 0.0, 0.0, 1.0])
    for size in (1.0, 1e-300, 1e150):
        turned = mechanics.rotation_matrix(size * quarter) @ np.array([1.0, 0.0, 0.0])
        assert turned == pytest.approx([0.0, 1.0, 0.0], abs=1e-15)
    with pytest.raises(ValueError, match="zero quaternion"):
        mechanics.rotation_matrix(np.zeros(4))
