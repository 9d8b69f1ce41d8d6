"""Two joined bodies: rows and intervals from readings, and the misfits of a joint that are zero for its own motion."""

from typing import Any

import numpy as np
import pytest

from scenes.courses import Array
from scenes.pairs import (
    clear,
    joint_misfits,
    ratios,
    refined_constants,
    robust,
    signs,
    slides,
    state,
    states,
    windows,
)
from scenes.protocol import Call, call

SIGMA, RATIO, POWER = 8e-4, 1.6, 2.5
MASS_1, MASS_2 = 2.0, 3.0


def _pushed(force: float, seconds: float) -> list[Call]:
    return [call("apply_force", object_id="object_1", force_vector=[force, 0, 0]), call("step", duration=seconds)]


def _exchanges(kind: str) -> list[tuple[Call, dict[str, Any]]]:
    """Pushes on two carts without resistance, which a joint of a kind couples; in small steps."""
    seen: list[tuple[Call, dict[str, Any]]] = []
    x1 = x2 = v1 = v2 = time = 0.0
    for force, seconds in ((10.0, 0.5), (6.0, 0.5), (10.0, 0.4), (-4.0, 0.3), (8.0, 0.6)):
        seen += [(asked, {}) for asked in _pushed(force, seconds)]
        h = 1e-4
        for _ in range(round(seconds / h)):
            slip = RATIO * v1 - v2
            if kind == "rigid":
                rate = force / (MASS_1 + RATIO**2 * MASS_2)
                rates = rate, RATIO * rate
            else:
                passed = POWER * (np.sign(slip) if kind == "clutch" else slip)
                rates = (force - RATIO * passed) / MASS_1, passed / MASS_2
            x1, x2 = x1 + h * (v1 + h * rates[0] / 2), x2 + h * (v2 + h * rates[1] / 2)
            v1, v2, time = v1 + h * rates[0], v2 + h * rates[1], time + h
        found = [{"position": [x1, 0, 0]}, {"position": [x2, 0, 0]}, {"velocity": [v1, 0, 0]}, {"velocity": [v2, 0, 0]}]
        seen += [(asked, reading | {"sim_time": time}) for asked, reading in zip(state(), found, strict=True)]
    return seen


def _win(kind: str) -> dict[str, Array]:
    return windows(states(_exchanges(kind)), slow=0.02, still=0.003, near=0.01)


def test_rows_have_time_places_speeds_and_forces_from_the_start_on() -> None:
    rows = states(_exchanges("rigid"))
    assert rows.shape == (6, 7)
    assert rows[0].tolist() == [0.0] * 7
    assert rows[1:, 5].tolist() == [10.0, 6.0, 10.0, -4.0, 8.0]
    assert rows[-1, 0] == pytest.approx(2.3)


def test_intervals_balance_impulse_and_momentum() -> None:
    win = _win("fluid")
    assert win["F"] == pytest.approx(MASS_1 * win["d1"] + RATIO * MASS_2 * win["d2"], abs=1e-9)


def test_the_integral_of_the_sign_of_a_speed_that_turns_round() -> None:
    found = signs(np.array([1.0, -1.0, 2.0]), np.array([-3.0, 1.0, 4.0]), np.array([2.0, 2.0, 2.0]))
    assert found == pytest.approx([-1.0, 0.0, 2.0])


@pytest.mark.parametrize(
    ("kind", "others"),
    [
        ("rigid", ("fluid",)),  # a clutch that does not slip is rigid, too
        ("clutch", ("rigid", "fluid")),
        ("fluid", ("rigid", "clutch")),
    ],
)
def test_the_motion_of_a_joint_fits_its_own_law_and_not_the_others(kind: str, others: tuple[str, ...]) -> None:
    win = _win(kind)
    taken, error = MASS_2 * win["d2"], np.full(len(win["dt"]), SIGMA * MASS_2)

    def misfit(law: str) -> float:
        return max(float(abs(part).max()) for part in joint_misfits(law, RATIO, POWER, taken, error, win, SIGMA))

    assert misfit(kind) < 1.0
    assert min(misfit(law) for law in others) > 3.0


def test_a_clutch_that_slips_offers_many_ratios_and_a_rigid_joint_the_one_that_is_seen() -> None:
    assert ratios("rigid", _win("rigid"), SIGMA) == [pytest.approx(RATIO, rel=1e-3)]
    assert slides(RATIO, _win("clutch"), SIGMA).any()
    assert not slides(RATIO, _win("rigid"), SIGMA).any()
    assert len(ratios("clutch", _win("clutch"), SIGMA)) > 3


def test_robust_least_squares_leaves_an_outlier_behind() -> None:
    x = np.linspace(0, 1, 20)
    right = 2.0 * x
    right[7] += 5.0
    assert robust(x[:, None], right, np.full(20, 0.01)) == pytest.approx([2.0], rel=1e-3)


def test_constants_are_refined_within_their_bounds_and_the_ratio_near_its_start() -> None:
    low, high = np.array([0.1, 0.1]), np.array([5.0, 5.0])

    def misfits(p: Array) -> Array:
        return 100 * (p - np.array([2.0, 3.0]))

    free = refined_constants(misfits, [np.array([1.0, 1.0])], low, high, keeps_ratio=False)
    assert free[1] == pytest.approx([2.0, 3.0], rel=1e-6)
    kept = refined_constants(misfits, [np.array([1.0, 1.0])], low, high, keeps_ratio=True)
    assert kept[1] == pytest.approx([1.1, 3.0], rel=1e-3)


def test_a_body_stays_clear_of_the_nets_if_it_can_be_stopped_in_time() -> None:
    assert clear(0.0, 1.0, 0.5, 0.5, 2.0, room=9.0, brake=8.0)
    assert not clear(8.0, 1.0, 0.5, 0.5, 2.0, room=9.0, brake=8.0)
    assert not clear(0.0, 7.0, 0.0, 0.5, 1.0, room=9.0, brake=8.0)
