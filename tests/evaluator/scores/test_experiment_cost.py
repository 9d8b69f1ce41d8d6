"""Tests of the cost of experiments: which calls and times count, and the used share of a scene's limits."""

import pytest

from evaluator.records.episode import Episode, Outcome
from evaluator.scores.dimensions import MedianCost, cost_of, median_cost
from scenes import LabLimits
from tests.builders.records import episode, refused, rejected, returned, skipped, turn

FREE = LabLimits()


def test_calls_that_the_laboratory_received_are_counted_without_the_answer() -> None:
    played = episode(
        turn("", returned("get_position", {"sim_time": 0.0}), refused("step", duration=-1), skipped("step")),
        turn("", rejected("step", duration="long"), returned("answer", {"sim_time": 0.0})),
    )
    found = cost_of(played, FREE)
    assert (found.calls, found.refused_calls, found.lab_time_s) == (2, 1, 0.0)


def test_lab_time_is_what_passed_in_steps_also_if_a_laboratory_sets_its_clock_back() -> None:
    played = episode(
        turn(
            "",
            returned("step", {"sim_time": 1.4849999999999903, "steps": 297}, duration=1.4866),
            returned("get_position", {"sim_time": 1.4849999999999903}),
            refused("step", duration=1e9),
            returned("reset", {"sim_time": 0.0}),
            returned("step", {"sim_time": 0.5}, duration=0.5),
        )
    )
    assert cost_of(played, FREE).lab_time_s == 1.985


def test_a_step_without_a_returned_time_counts_with_its_duration() -> None:
    played = episode(turn("", returned("step", {"status": "ok"}, duration=0.25), returned("step", {}, duration=True)))
    assert cost_of(played, FREE).lab_time_s == 0.25


def test_what_was_used_of_a_limit_is_at_most_all_of_it() -> None:
    played = episode(
        turn(
            "", *(returned("step", {"sim_time": time}, duration=1) for time in (1.0, 2.0)), refused("step", duration=1)
        )
    )
    found = cost_of(played, LabLimits(calls=4, lab_time=8))
    assert (found.calls_of_limit, found.lab_time_of_limit) == (0.75, 0.25)
    assert cost_of(played, LabLimits(calls=2)).calls_of_limit == 1.0
    assert cost_of(played, LabLimits(calls=2)).lab_time_of_limit is None


def test_a_group_has_medians_and_shares_only_over_episodes_with_a_limit() -> None:
    def played(calls: int) -> Episode:
        return episode(turn("", *[returned("step", {"sim_time": 0.1 * n}) for n in range(1, calls + 1)]))

    costs = [cost_of(played(calls), limits) for calls, limits in ((2, FREE), (4, LabLimits(calls=8)), (9, FREE))]
    found = median_cost(costs)
    assert (found.calls, found.refused_calls, found.lab_time_s) == (4, 0, pytest.approx(0.4))
    assert (found.calls_of_limit, found.n_calls_limited) == (0.5, 1)
    assert (found.lab_time_of_limit, found.n_lab_time_limited) == (None, 0)


def test_an_episode_without_calls_costs_nothing_and_no_episode_has_no_cost() -> None:
    unplayed = episode(outcome=Outcome.BUDGET_EXHAUSTED)
    assert (cost_of(unplayed, FREE).calls, cost_of(unplayed, FREE).lab_time_s) == (0, 0.0)
    assert median_cost([]) == MedianCost(
        calls=None,
        refused_calls=None,
        lab_time_s=None,
        calls_of_limit=None,
        n_calls_limited=0,
        lab_time_of_limit=None,
        n_lab_time_limited=0,
    )
