"""Tests of pass@k and pass^k against their definition: all ways to choose k of the tries."""

import itertools
from statistics import fmean

import pytest
from hypothesis import given
from hypothesis import strategies as st

from evaluator.statistics.intervals import attempts, pass_at_k, pass_hat_k


@given(st.lists(st.booleans(), min_size=1, max_size=8), st.data())
def test_both_are_shares_of_all_ways_to_choose_k_tries(tries: list[bool], data: st.DataObject) -> None:
    k = data.draw(st.integers(min_value=1, max_value=len(tries)))
    chosen = list(itertools.combinations(tries, k))
    assert pass_at_k(len(tries), sum(tries), k) == pytest.approx(fmean(map(any, chosen)))
    assert pass_hat_k(len(tries), sum(tries), k) == pytest.approx(fmean(map(all, chosen)))


@given(st.integers(min_value=1, max_value=300), st.data())
def test_pass_at_k_equals_the_product_formula_of_the_paper(tries: int, data: st.DataObject) -> None:
    """Chen et al. 2021, arXiv:2107.03374, figure 3 gives equation 1 as 1 - Π (1 - k / i) over i from n - c + 1 to n."""
    successes = data.draw(st.integers(min_value=0, max_value=tries))
    k = data.draw(st.integers(min_value=1, max_value=tries))
    product = 1.0
    for factor in range(tries - successes + 1, tries + 1):
        product *= max(0.0, 1 - k / factor)
    assert pass_at_k(tries, successes, k) == pytest.approx(1 - product, abs=1e-9)


@pytest.mark.parametrize("k", [0, 4])
def test_k_must_lie_between_1_and_the_number_of_tries(k: int) -> None:
    for measure in (pass_at_k, pass_hat_k):
        with pytest.raises(ValueError, match="between 1 and the number of tries, 3"):
            measure(3, 1, k)


def test_means_over_scenes_match_a_manual_calculation() -> None:
    # Successes: 2 of 4, 4 of 5, 0 of 4. At k = 2, pass@k is 1 - 1/6, 1 and 0, and pass^k is 1/6, 6/10 and 0.
    found = attempts({7: [True, True, False, False], 8: [True] * 4 + [False], 9: [False] * 4})
    assert found is not None
    assert (found.n, found.n_scenes, found.tries) == (13, 3, 4)
    assert [point.k for point in found.points] == [1, 2, 4]
    assert found.points[0].pass_at_k == pytest.approx((0.5 + 0.8 + 0) / 3)
    assert found.points[0].pass_hat_k == pytest.approx(found.points[0].pass_at_k)
    assert found.points[1].pass_at_k == pytest.approx((5 / 6 + 1 + 0) / 3)
    assert found.points[1].pass_hat_k == pytest.approx((1 / 6 + 6 / 10 + 0) / 3)
    assert found.points[2].pass_hat_k == pytest.approx((0 + 1 / 5 + 0) / 3)
    assert found.points[0].pass_at_k_interval is None  # three scenes


def test_intervals_need_enough_scenes_and_lie_between_0_and_1() -> None:
    found = attempts({scene: [scene < 9, True, False] for scene in range(12)})
    assert found is not None
    for point in found.points:
        for share, interval in (
            (point.pass_at_k, point.pass_at_k_interval),
            (point.pass_hat_k, point.pass_hat_k_interval),
        ):
            assert interval is not None
            assert 0 <= interval.low <= share <= interval.high <= 1


def test_with_a_single_try_there_is_no_pass_at_k() -> None:
    assert attempts({7: [True, False], 8: [True]}) is None
    assert attempts({}) is None
