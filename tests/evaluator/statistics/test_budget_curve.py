"""Tests of budget curves on simulated runs with known accuracies."""

import numpy as np
import pytest

from evaluator.statistics.paired import BudgetCurve, Cell, CurveShape, PairedTest, budget_curve

BUDGETS = (5, 10, 15, 20)


def curve_of(*chances: float, scenes: int = 105, seeds: int = 1, seed: int = 1) -> BudgetCurve:
    """Return the curve of a simulated run.

    An episode is right if a weighted sum of the scene's difficulty and a random number is below the budget's chance.
    """
    rng = np.random.default_rng(seed)
    difficulty = rng.random(scenes)
    cells = [
        Cell(scene, tuple(bool((0.7 * difficulty[scene] + 0.3 * rng.random()) < chance) for chance in chances))
        for scene in range(scenes)
        for _ in range(seeds)
    ]
    return budget_curve(BUDGETS[: len(chances)], cells)


def cells(*counts: int, scenes: int) -> list[Cell]:
    """One episode per scene; at each budget the first `count` scenes are right."""
    return [Cell(scene, tuple(scene < count for count in counts)) for scene in range(scenes)]


def test_a_curve_matches_a_manual_calculation() -> None:
    found = budget_curve(BUDGETS, cells(40, 60, 62, 62, scenes=100))
    assert (found.n, found.n_scenes) == (100, 100)
    assert [point.budget for point in found.points] == [5, 10, 15, 20]
    assert [point.accuracy.n_correct for point in found.points] == [40, 60, 62, 62]
    first, second, third, fourth = (point.gain for point in found.points)
    assert first is None
    assert second is not None
    assert third is not None
    assert fourth is not None
    assert (second.difference, second.only_first, second.only_second) == (pytest.approx(0.2), 0, 20)
    assert second.p_value == pytest.approx(2 / 2**20)
    assert (third.difference, fourth.difference) == (pytest.approx(0.02), 0)
    # Holm multiplies the smallest of six p-values (22 gains of 22) by six.
    assert found.shape is CurveShape.RISING
    assert found.certainty == pytest.approx(1 - 6 * 2 / 2**22)
    # Beyond 10 iterations the gain is 2 points; a resampled gain above the margin of 5 points is rare.
    assert found.enough == 10
    assert found.enough_certainty is not None
    assert found.enough_certainty > 0.95


def test_the_largest_budget_is_enough_if_gains_do_not_end() -> None:
    found = budget_curve(BUDGETS, cells(20, 40, 60, 80, scenes=100))
    assert (found.shape, found.enough, found.enough_certainty) == (CurveShape.RISING, 20, None)


def test_a_gain_equal_to_the_margin_does_not_count() -> None:
    found = budget_curve((5, 10), cells(80, 85, scenes=100))
    assert found.enough == 5
    assert found.shape is CurveShape.FLAT  # 5 gains of 5 pairs: p = 0.06


def test_a_peak_in_the_middle_makes_the_end_of_gains_less_certain() -> None:
    # Budget 10 gains four of 100 scenes and budget 15 loses them; with other scenes the gain could exceed the margin.
    found = budget_curve((5, 10, 15), cells(50, 54, 50, scenes=100))
    assert found.enough == 5
    assert found.enough_certainty is not None
    assert 0.6 < found.enough_certainty < 0.9


def test_falling_and_mixed_curves_are_recognised() -> None:
    falling = curve_of(0.7, 0.5, 0.4, 0.3)
    mixed = curve_of(0.3, 0.7, 0.7, 0.4)
    assert (falling.shape, falling.enough) == (CurveShape.FALLING, 5)
    assert mixed.shape is CurveShape.MIXED
    assert falling.certainty is not None
    assert falling.certainty > 0.99
    assert mixed.certainty is not None
    assert 0.95 <= mixed.certainty <= 1


def test_a_flat_shape_is_more_certain_with_more_episodes() -> None:
    few, many = curve_of(0.5, 0.5, 0.5, 0.5, scenes=30), curve_of(0.5, 0.5, 0.5, 0.5, scenes=300, seeds=5)
    assert few.shape is many.shape is CurveShape.FLAT
    assert few.certainty is not None
    assert many.certainty is not None
    assert few.certainty < 0.7 < many.certainty


@pytest.mark.extended
def test_a_flat_curve_is_misjudged_in_at_most_5_per_cent_of_runs() -> None:
    """Simulates 150 runs of 60 scenes with equal chances at all budgets."""
    shapes = [curve_of(0.5, 0.5, 0.5, 0.5, scenes=60, seed=seed).shape for seed in range(150)]
    assert sum(shape is not CurveShape.FLAT for shape in shapes) <= 7


def test_seeds_of_a_scene_do_not_count_as_scenes() -> None:
    # Two of ten scenes become solvable, each on all twenty seeds: two independent gains, not forty.
    played = [Cell(scene, (scene < 4, scene < 6)) for scene in range(10) for _ in range(20)]
    found = budget_curve((5, 20), played)
    assert found.points[1].gain is not None
    assert (found.points[1].gain.test, found.points[1].gain.p_value) == (PairedTest.SIGN_FLIP, 0.5)
    assert found.shape is CurveShape.FLAT


def test_too_few_scenes_are_not_resampled() -> None:
    found = budget_curve((5, 20), cells(2, 2, scenes=5))
    assert (found.shape, found.certainty, found.enough, found.enough_certainty) == (CurveShape.FLAT, None, 5, None)


def test_with_a_single_scene_its_episodes_are_resampled() -> None:
    found = budget_curve((5, 20), [Cell(7, (False, seed < 15)) for seed in range(20)])
    assert (found.shape, found.n_scenes) == (CurveShape.RISING, 1)
    alike = budget_curve((5, 20), [Cell(7, (seed < 15, seed < 15)) for seed in range(20)])
    assert (alike.shape, alike.certainty) == (CurveShape.FLAT, 1.0)


@pytest.mark.parametrize("budgets", [(5,), (20, 5), (5, 5)])
def test_budgets_must_ascend_and_be_at_least_two(budgets: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="two or more budgets, ascending"):
        budget_curve(budgets, [Cell(7, tuple(True for _ in budgets))])


def test_a_curve_without_episodes_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one pair"):
        budget_curve((5, 10), [])
