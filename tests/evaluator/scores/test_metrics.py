"""Tests of dimensions, Final Score and summaries against values computed by hand and published ones."""

import itertools
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evaluator.answers.rewards import Chance
from evaluator.records.episode import (
    UNREAD,
    Choice,
    Exchange,
    Grade,
    NormalisationClass,
    Outcome,
    Verdict,
)
from evaluator.records.evidence import EvidenceRecord, EvidenceVerdict
from evaluator.scores.dimensions import WEIGHTS, final_score, non_repetition
from evaluator.scores.grouping import quadrant
from evaluator.scores.metrics import GroupSummary, held_out_accuracy, summarise
from evaluator.scores.scored_episode import ScoredEpisode
from evaluator.scores.wording import floor_sentence
from evaluator.statistics.ability import ability_of
from evaluator.statistics.intervals import wilson_interval
from tests.builders.records import RIGHT, UNSCORED, WRONG, call, episode, episode_key, grade, returned, turn
from tests.builders.scored import scored, scores_of

HALF = grade(right=False, graded=0.5)
FORGIVEN = Grade(
    strict=Verdict.INCORRECT,
    graded=0.0,
    normalised=Verdict.CORRECT,
    normalisation=NormalisationClass.ANSWER_FORMAT,
    reason="",
)


def exchange(tool: str = "step", *, ran: bool = True, error: bool = False) -> Exchange:
    return Exchange(call=call(tool), returned=ran, is_error=error)


def row(
    grade: Grade,
    category: str = "easy-single",
    *,
    agent: str = "x",
    budget: int = 20,
    outcome: Outcome = Outcome.ANSWERED,
    problem_type: str = "calculation",
) -> ScoredEpisode:
    played = episode(turn("push", exchange("answer")), key=episode_key(agent=agent, budget=budget), outcome=outcome)
    return scored(played, grade, category, problem_type)


# The paper's table: C, E, G, V, R, G' → FS.
PUBLISHED = [
    ((0.583, 0.537, 0.729, 1.000, 0.701, 0.476), 64.1),
    ((0.555, 0.420, 0.598, 1.000, 0.657, 0.437), 58.4),
    ((0.503, 0.655, 0.544, 0.999, 0.613, 0.580), 60.0),
    ((0.480, 0.418, 0.514, 1.000, 0.633, 0.588), 55.4),
    ((0.351, 0.238, 0.744, 1.000, 0.700, 0.426), 50.0),
    ((0.308, 0.201, 0.702, 0.999, 0.708, 0.381), 46.7),
    ((0.224, 0.280, 0.712, 1.000, 0.678, 0.432), 44.9),
]


@pytest.mark.parametrize(("row", "published"), PUBLISHED)
def test_the_published_rows_give_the_published_score(row: tuple[float, ...], published: float) -> None:
    # No tolerance is needed: although each printed input is rounded by up to 0.0005 (0.05 points of the score, because
    # the weights add up to 1), the score rounds to the printed one.
    assert round(final_score(*row), 1) == published


def test_the_weights_add_up_to_one() -> None:
    assert sum(WEIGHTS.values()) == pytest.approx(1)
    assert final_score(1, 1, 1, 1, 1, 1) == pytest.approx(100)


def test_undefined_dimensions_count_0_in_the_score() -> None:
    assert final_score(1, 0.5, None, None, None, None) == pytest.approx(100 * (0.40 + 0.15 * 0.5))


# One episode.
def test_efficiency_is_the_share_of_the_budget_that_is_left() -> None:
    turns = [turn("", exchange()) for _ in range(5)]
    assert scores_of(episode(*turns, key=episode_key(budget=20)), RIGHT).e == pytest.approx(0.75)
    assert scores_of(episode(*turns, key=episode_key(budget=5)), RIGHT).e == 0
    assert scores_of(episode(*turns, key=episode_key(budget=20)), WRONG).e == pytest.approx(0.75)
    limited_by_calls = episode(*turns, key=episode_key(budget=5)).model_copy(update={"max_calls": 50})
    assert scores_of(limited_by_calls, RIGHT).e == pytest.approx(0.9)


@pytest.mark.parametrize("outcome", [Outcome.BUDGET_EXHAUSTED, Outcome.AGENT_ERROR, Outcome.INFRASTRUCTURE_ERROR])
def test_efficiency_is_0_without_an_answer(outcome: Outcome) -> None:
    assert scores_of(episode(turn(), outcome=outcome), WRONG).e == 0


def test_correctness_is_the_graded_correctness() -> None:
    assert [scores_of(episode(), grade).c for grade in (RIGHT, HALF, WRONG, UNSCORED)] == [1, 0.5, 0, None]


def test_validity_counts_error_results_and_rejected_calls_but_not_the_calls_skipped_after_them() -> None:
    played = episode(
        turn("", exchange(), exchange(error=True), exchange()),
        # A rejected call, and a call that was skipped after it.
        turn("", exchange(), exchange(ran=False, error=True), exchange(ran=False)),
        turn("", exchange("answer")),
    )
    scores = scores_of(played, RIGHT)
    # Made: 3 + 2 + 1 = 6, of which one returned an error and one was rejected.
    assert (scores.v, scores.calls, scores.disabled_calls) == (pytest.approx(4 / 6), 6, 0)


def test_calls_to_disabled_tools_are_counted_apart() -> None:
    played = episode(turn("", exchange(), exchange("detect_collision", error=True), exchange("answer")))
    scores = scores_of(played, RIGHT, frozenset({"detect_collision"}))
    assert (scores.v, scores.calls, scores.disabled_calls) == (pytest.approx(2 / 3), 3, 1)
    assert scores.v_enabled == 1


def test_without_a_call_that_the_laboratory_ran_validity_and_diversity_are_undefined() -> None:
    silent = episode(turn("I guess that it moves.", exchange("answer")))
    rejected = episode(turn("I step, I step.", exchange(ran=False, error=True)), turn("So 1.", exchange("answer")))
    for played in (silent, rejected):
        scores = scores_of(played, RIGHT)
        assert (scores.v, scores.v_enabled, scores.r) == (None, None, None)
    refused = scores_of(episode(turn("I step, I step.", exchange(error=True)), turn("", exchange("answer"))), RIGHT)
    assert (refused.v, refused.r) == (0.5, pytest.approx(1 / 3))


def test_without_calls_words_or_assertions_the_dimensions_are_undefined() -> None:
    scores = scores_of(episode(turn(""), turn(" …\n"), outcome=Outcome.AGENT_ERROR), WRONG)
    assert (scores.g, scores.v, scores.r) == (None, None, None)


def test_grounding_is_the_share_of_supported_assertions() -> None:
    read = returned("get_velocity", {"velocity": [1.5, 0.0, 0.0]})
    scores = scores_of(episode(turn("", read), turn("It has 1.5 m/s, so 7 J.", exchange("answer"))), RIGHT)
    assert scores.g == pytest.approx(0.5)


@pytest.mark.parametrize(
    ("reasoning", "expected"),
    [
        ([], None),
        (["", "  "], None),
        (["…!"], None),
        (["Push"], 1.0),
        (["push the ball now"], 1.0),
        # the-ball, ball-the, the-ball, ball-rolls: 2 of 4.
        (["The ball, the ball rolls"], 0.5),
        # A bigram never spans two turns: read-it twice among two.
        (["Read it.", "read IT"], 0.0),
        (["read", "it", "read", "it"], 1.0),
        # A decimal and an id are one word each: object_2-is, is-0.5, 0.5-object_2, object_2-is: 2 of 4.
        (["object_2 is 0.5; object_2 is"], 0.5),
        # Five words, one bigram four times.
        (["go go go go go"], 0.0),
    ],
)
def test_non_repetition_by_hand(reasoning: list[str], expected: float | None) -> None:
    found = non_repetition(reasoning)
    assert found == (None if expected is None else pytest.approx(expected))


# A run.
def test_held_out_accuracy_is_the_mean_over_the_other_categories_each_counted_once() -> None:
    rows = [
        row(RIGHT, "easy-single"),
        *(row(RIGHT, "hard-single"), row(WRONG, "hard-single")),
        *(row(RIGHT, "hard-multi"), row(WRONG, "hard-multi"), row(FORGIVEN, "hard-multi"), row(HALF, "hard-multi")),
        row(UNSCORED, "easy-multi", outcome=Outcome.INFRASTRUCTURE_ERROR),
    ]
    found = {category: value for (_, category), value in held_out_accuracy(rows).items()}
    # Accuracies: 1, 1/2 and 1/4; a category without scored episodes is left out.
    assert found == {
        "easy-single": pytest.approx((1 / 2 + 1 / 4) / 2),
        "hard-single": pytest.approx((1 + 1 / 4) / 2),
        "hard-multi": pytest.approx((1 + 1 / 2) / 2),
    }


def test_held_out_accuracy_is_not_pooled_over_agents_or_budgets() -> None:
    rows = [
        *(row(RIGHT, "easy-single", agent="a"), row(RIGHT, "hard-single", agent="a")),
        *(row(WRONG, "easy-single", agent="b"), row(WRONG, "hard-single", agent="b")),
        row(RIGHT, "easy-single", agent="b", budget=5),
    ]
    summary = summarise(rows)
    assert summary.by_agent["a"].g_prime == 1
    assert (summary.by_agent["b"].g_prime, summary.by_agent["b"].n_defined["g_prime"]) == (0, 2)
    assert summary.by_agent["b"].final_score is None
    assert summary.by_budget[20].g_prime == pytest.approx(0.5)
    assert summary.by_budget[5].g_prime is None
    assert summary.by_budget[5].n_defined["g_prime"] == 0


def test_a_run_of_one_category_has_no_held_out_accuracy_and_no_final_score() -> None:
    overall = summarise([row(RIGHT), row(WRONG)]).overall
    assert (overall.g_prime, overall.final_score, overall.strict_accuracy) == (None, None, 0.5)


def test_a_whole_run_computed_by_hand() -> None:
    played = episode(turn("It moves at 1.5 m/s", exchange(), exchange(error=True)), turn("", exchange("answer")))
    silent = episode(turn("", exchange("answer")), key=episode_key(8))
    unread = turn("no idea").model_copy(update={"note": f"{UNREAD}: it has 2 sets of calls"})
    lost = episode(unread, outcome=Outcome.BUDGET_EXHAUSTED, key=episode_key(51))
    broken = episode(outcome=Outcome.INFRASTRUCTURE_ERROR, key=episode_key(52))
    summary = summarise(
        [
            scored(played, HALF, "easy-single", "computation"),
            scored(silent, RIGHT, "easy-single", "comparison", disabled_tools=frozenset({"step"})),
            scored(lost, WRONG, "easy-multi", "comparison"),
            scored(broken, UNSCORED, "easy-multi-hidden", "comparison"),
        ]
    )
    overall = summary.overall
    assert (overall.n, overall.n_scored, overall.n_correct) == (4, 3, 1)
    assert overall.strict_accuracy == pytest.approx(1 / 3)
    assert overall.normalised_accuracy == pytest.approx(1 / 3)
    assert overall.strict_interval == wilson_interval(1, 3)
    assert overall.c == pytest.approx((0.5 + 1 + 0) / 3)
    assert overall.e == pytest.approx((0.9 + 0.95 + 0) / 3)
    # A single number is stated, too few for a share. Only the first episode has an experiment.
    assert (overall.g, overall.n_numbers) == (None, 1)
    assert overall.v == pytest.approx((2 / 3) / 3)
    assert overall.r == pytest.approx(1 / 3)
    # Of four turns, two have no text: the second turn of the first episode and the only turn of the second.
    assert overall.silent_turns == pytest.approx(2 / 4)
    assert overall.unread_turns == 1
    assert overall.n_defined == {
        "c": 3,
        "e": 3,
        "g": 1,
        "g_plus": 1,
        "v": 1,
        "v_enabled": 1,
        "step_credit": 0,
        "r": 1,
        "g_prime": 3,
    }
    # Easy-single is 1/2 right, easy-multi 0: held out, the three episodes have 0, 0 and 1/2.
    assert overall.g_prime == pytest.approx(0.5 / 3)
    assert overall.final_score == pytest.approx(
        100 * (0.40 * 0.5 + 0.15 * 1.85 / 3 + 0.10 * (2 / 9) + 0.10 * (1 / 3) + 0.10 * 0.5 / 3)
    )
    assert overall.final_score_of_defined == pytest.approx((overall.final_score or 0) / 0.85)
    # The first episode defines all but G′, the second C and E; the third has no right part.
    first = (0.40 * 0.5 + 0.15 * 0.9 + 0.10 * 2 / 3 + 0.10) / 0.90
    second = (0.40 + 0.15 * 0.95) / 0.55
    assert overall.gated == pytest.approx(100 * (0.5 * first + second) / 3)
    assert overall.outcomes == {
        Outcome.ANSWERED: 2,
        Outcome.BUDGET_EXHAUSTED: 1,
        Outcome.INFRASTRUCTURE_ERROR: 1,
    }
    assert list(summary.by_category) == ["easy-multi", "easy-multi-hidden", "easy-single"]
    counted = {"outcomes", "failures", "experiment_cost", "forgiven"}
    assert summary.by_category["easy-multi-hidden"].model_dump(exclude=counted) == {
        **dict.fromkeys(summary.overall.model_dump(exclude=counted)),
        "n": 1,
        "n_scored": 0,
        "n_scenes": 0,
        "n_correct": 0,
        "n_withdrawn": 0,
        "disabled_calls": 0,
        "unread_turns": 0,
        "n_numbers": 0,
        "n_defined": dict.fromkeys(overall.n_defined, 0),
    }
    assert {name: group.n for name, group in summary.by_quadrant.items()} == {"easy-multi": 2, "easy-single": 2}
    assert {name: group.n for name, group in summary.by_problem_type.items()} == {"comparison": 3, "computation": 1}
    assert set(summary.by_prompting) == {"zero-shot"}


def test_a_dimension_that_no_episode_defines_is_undefined() -> None:
    overall = summarise([row(RIGHT, "easy-single"), row(RIGHT, "hard-single")]).overall
    assert (overall.g, overall.n_defined["g"]) == (None, 0)
    assert overall.final_score == pytest.approx(100 * (0.40 + 0.15 * 0.95 + 0.10))
    assert overall.final_score_of_defined == pytest.approx((overall.final_score or 0) / 0.65)


def test_of_twenty_numbers_or_more_the_grounded_share_is_pooled() -> None:
    read = returned("get_position", {"position": [1.5, 0.0, 0.0]}, object_id="object_1")
    stated = " ".join(["It is at 1.5 m."] * 15 + ["It weighs 77.3 kg."] * 5)
    rows = [scored(episode(turn("", read), turn(stated), turn("", returned("answer"))), RIGHT), row(RIGHT)]
    overall = summarise(rows).overall
    assert (overall.n_numbers, overall.g, overall.g_plus) == (20, 0.75, 0.75)


def test_the_ability_in_an_adaptive_test_is_estimated_for_each_condition_from_scored_episodes() -> None:
    choice = Choice(ability=0, se=3, information=0.2, rank=1, difficulty=1.0, difficulty_se=0.3, variant_sd=0.5)

    def chosen(scene: int, agent: str, verdict: Grade) -> ScoredEpisode:
        played = episode(key=episode_key(scene, agent=agent)).model_copy(update={"chosen": choice})
        return scored(played, verdict)

    rows = [chosen(7, "x", RIGHT), chosen(8, "x", UNSCORED), chosen(7, "y", WRONG), row(RIGHT, agent="x")]
    able, unable = summarise(rows).abilities
    assert (able.agent, unable.agent) == ("x", "y")
    assert able.estimate == ability_of([(7, 0, choice, True)])
    assert unable.estimate == ability_of([(7, 0, choice, False)])


def test_the_verdict_on_evidence_needs_a_measurement() -> None:
    plain = row(RIGHT)
    assert plain.evidence_verdict is None
    measured = replace(plain, evidence=EvidenceRecord(key=plain.key, episode="0"))
    assert measured.evidence_verdict is EvidenceVerdict.GUESSED


def test_normalised_accuracy_is_reported_with_strict_accuracy() -> None:
    overall = summarise([row(RIGHT), row(FORGIVEN), row(WRONG), row(WRONG)]).overall
    assert (overall.strict_accuracy, overall.normalised_accuracy) == (0.25, 0.5)


def test_an_empty_run_has_no_numbers() -> None:
    summary = summarise([])
    assert (summary.overall.n, summary.overall.strict_accuracy, summary.overall.strict_interval) == (0, None, None)
    assert summary.by_category == {}


@pytest.mark.parametrize(
    ("category", "expected"),
    [
        ("easy-single", "easy-single"),
        ("hard-multi-hidden", "hard-multi"),
        ("create-delete-attach", "create-delete-attach"),
        ("uncategorised", "uncategorised"),
        ("easy", "easy"),
    ],
)
def test_categories_fall_into_quadrants(category: str, expected: str) -> None:
    assert quadrant(category) == expected


@settings(max_examples=50)
@given(data=st.data())
def test_numbers_stay_in_bounds_and_do_not_depend_on_the_order(data: st.DataObject) -> None:
    grades = data.draw(st.lists(st.sampled_from([RIGHT, WRONG, HALF, FORGIVEN, UNSCORED]), min_size=1, max_size=12))
    categories = itertools.cycle(["easy-single", "hard-multi", "create-delete-attach"])
    rows = [row(grade, category) for grade, category in zip(grades, categories, strict=False)]
    summary = summarise(rows)
    assert summarise(data.draw(st.permutations(rows))) == summary
    for group in (summary.overall, *summary.by_category.values()):
        for share in (group.strict_accuracy, group.normalised_accuracy, group.c, group.e, group.g_prime):
            assert share is None or 0 <= share <= 1
        assert group.final_score is None or 0 <= group.final_score <= 100
        assert sum(group.outcomes.values()) == group.n


def test_skill_is_0_for_a_blind_guess_and_1_for_a_perfect_agent_with_the_interval_of_the_accuracy() -> None:
    def of(grades: list[Grade], chance: float) -> GroupSummary:
        key = itertools.count(7)
        return summarise(
            [scored(episode(key=episode_key(next(key))), grade, chance=Chance(chance, chance)) for grade in grades]
        ).overall

    half = of([RIGHT, WRONG, RIGHT, WRONG], 0.2)
    assert (half.blind_accuracy, half.skill) == (pytest.approx(0.2), pytest.approx((0.5 - 0.2) / 0.8))
    interval = wilson_interval(2, 4)
    assert half.skill_interval is not None
    assert half.skill_interval.low == pytest.approx((interval.low - 0.2) / 0.8)
    assert half.skill_interval.high == pytest.approx((interval.high - 0.2) / 0.8)
    assert of([RIGHT] * 4, 0.2).skill == pytest.approx(1)
    assert of([RIGHT, WRONG, WRONG, WRONG, WRONG], 0.2).skill == pytest.approx(0)
    assert of([RIGHT, RIGHT], 1.0).skill is None


def test_an_agent_that_never_experiments_gets_the_score_of_a_guess_in_one_turn() -> None:
    rows = [
        scored(episode(key=episode_key(7, budget=5)), WRONG, "easy-single", chance=Chance(0.1, 0.2)),
        scored(episode(key=episode_key(26, budget=5)), RIGHT, "hard-single", chance=Chance(0.3, 0.4)),
    ]
    overall = summarise(rows).overall
    assert overall.blind_score == pytest.approx(100 * (0.40 * 0.3 + 0.15 * 0.8 + 0.10 * 0.2))
    assert floor_sentence({"x": overall}) == (
        "an agent that never experiments gets a Final Score of 26.0 on the same scenes, seeds and budgets"
    )
    alone = summarise(rows[:1]).overall
    assert (alone.blind_score, floor_sentence({"x": alone})) == (None, "")
