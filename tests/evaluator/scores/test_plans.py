"""Tests that numbers in statements of intent, such as "I will try 1 N", do not count as assertions."""

import pytest

from evaluator.scores.evidence import is_planned, plans_in
from evaluator.scores.grounding import grounding_of
from tests.builders.records import episode, returned, turn

READ = returned("get_velocity", {"velocity": [1.5, 0.0, 0.0]})


@pytest.mark.parametrize(
    ("text", "planned"),
    [
        ("It moves at 1.5 m/s.", ""),
        ("I'll push with 2.5 N. It moves at 1.5 m/s.", "I'll push with 2.5 N"),
        ("So v = 1.5 m/s; let me wait 0.5 s.", "let me wait 0.5 s"),
        ("We are going to wait 0.25 s because it moves at 1.5 m/s.", "We are going to wait 0.25 s "),
        ("I will try 1 N\nv = 1.5", "I will try 1 N"),
        ("I will wait. Let’s try 3 N, 4 N", "I will wait|Let’s try 3 N, 4 N"),
        ("It will reach 4.2 m/s.", ""),
        ("Plan: push with 2 N!", "Plan: push with 2 N"),
    ],
)
def test_a_plan_ends_with_its_sentence_or_at_a_reason(text: str, planned: str) -> None:
    assert "|".join(text[plan.start : plan.end] for plan in plans_in(text)) == planned


def test_a_character_is_planned_from_the_first_to_before_the_end() -> None:
    (plan,) = plans_in("Now I will go. Yes")
    found = [is_planned([plan], place) for place in (plan.start - 1, plan.start, plan.end - 1, plan.end)]
    assert found == [False, True, True, False]


def test_numbers_of_plans_and_of_later_calls_are_no_statements() -> None:
    played = episode(
        turn("First 4.2 N, then more. I'm going to compare with 7.7 m/s.", READ),
        turn("It has 1.5 m/s, which is not 3.3 m/s.", returned("apply_force", {}, force_vector=[4.2, 0, 0])),
    )
    assert [found.text for found in grounding_of(played).assertions] == ["1.5 m/s", "3.3 m/s"]
