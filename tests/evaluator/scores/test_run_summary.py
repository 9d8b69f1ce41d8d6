"""Tests of the statistics in the summary of a run and in the terminal."""

import json
import subprocess
import sys
from collections.abc import Callable

import pytest
from jsonschema import Draft202012Validator

from evaluator.commands.terminal import summary_lines
from evaluator.records.episode import EpisodeKey, Outcome
from evaluator.scores.dimensions import SCORING_VERSION
from evaluator.scores.grouping import NO_RUNG, modality, problem_kind
from evaluator.scores.metrics import RunSummary, summarise
from evaluator.scores.scored_episode import ScoredEpisode
from evaluator.scores.wording import curve_sentence
from evaluator.statistics.intervals import IntervalMethod, proportion
from evaluator.statistics.paired import Cell, CurveShape, budget_curve
from scenes import LabLimits
from tests.builders.paths import DOCS
from tests.builders.records import episode, episode_key, grade, returned, turn
from tests.builders.scored import scored

SCHEMA = DOCS / "reference" / "run-summary.schema.json"


def rows(
    right: Callable[[EpisodeKey], bool | None],
    *,
    scenes: int = 12,
    budgets: tuple[int, ...] = (20,),
    seeds: int = 1,
    agents: tuple[str, ...] = ("x",),
    protocol: str = "native",
) -> list[ScoredEpisode]:
    found: list[ScoredEpisode] = []
    for key in (
        episode_key(7 + scene, seed=seed, agent=agent, budget=budget, protocol=protocol)
        for scene in range(scenes)
        for seed in range(seeds)
        for agent in agents
        for budget in budgets
    ):
        said = right(key)
        played = episode(key=key, outcome=Outcome.INFRASTRUCTURE_ERROR if said is None else Outcome.BUDGET_EXHAUSTED)
        kind = "comparison" if key.scene % 2 else "computation"
        found.append(scored(played, grade(said), "hard-multi-hidden" if key.scene % 3 else "easy-single", kind))
    return found


def test_the_interval_of_a_group_is_clustered_by_scene() -> None:
    summary = summarise(rows(lambda key: key.scene < 12, seeds=5))
    whole = summary.overall
    assert (whole.n_scored, whole.n_scenes, whole.n_correct) == (60, 12, 25)
    assert whole.interval_method is IntervalMethod.CLUSTERED
    expected = proportion((scene, scene < 5) for scene in range(12) for _ in range(5))
    assert whole.strict_interval == whole.normalised_interval == expected.interval
    one_each = summarise(rows(lambda key: key.scene < 12)).overall
    assert one_each.interval_method is IntervalMethod.WILSON


def open_worlds(graded: tuple[float, ...], agent: str = "x") -> list[ScoredEpisode]:
    """Return an episode in an open world for each share of right predictions."""
    return [
        scored(
            episode(turn("", returned("step", {"sim_time": 2.0})), key=episode_key(201 + number, agent=agent)),
            grade(share == 1, graded=share),
            "open",
            limits=LabLimits(calls=4, lab_time=8),
        )
        for number, share in enumerate(graded)
    ]


def test_open_worlds_stand_on_a_rung_of_their_own_and_change_no_other_number() -> None:
    suite = rows(lambda key: key.scene % 2 == 0, budgets=(5, 20), seeds=2)
    alone, mixed = summarise(suite), summarise([*suite, *open_worlds((1.0, 2 / 3, 0.0))])
    assert list(mixed.by_rung) == ["easy", "hard", "open"]
    assert mixed.by_rung.pop("open").n == 3
    assert mixed == alone


def test_in_open_worlds_c_is_the_share_of_predictions_that_are_right() -> None:
    played = open_worlds((1.0, 2 / 3, 0.0))
    summary = summarise(played)
    found = summary.by_rung["open"]
    assert (found.n_correct, found.n_scored, found.c) == (1, 3, pytest.approx(5 / 9))
    assert (found.experiment_cost.calls, found.experiment_cost.calls_of_limit) == (1, 0.25)
    assert (summary.overall.n, summary.by_category, summary.by_agent) == (0, {}, {})
    assert summary_lines(summary, played) == [
        "open worlds: all predictions right 33.3 % (1/3), predictions right 55.6 %",
        "cost of experiment (medians): calls 1, lab time 2 s",
        "answered 3",
    ]


def test_several_agents_are_never_pooled_in_the_terminal() -> None:
    def of(agent: str) -> list[ScoredEpisode]:
        right = agent == "good"
        return [*rows(lambda _: right, agents=(agent,), scenes=4), *open_worlds((float(right),) * 4, agent)]

    played = [*of("good"), *of("bad")]
    lines = summary_lines(summarise(played), played)
    assert not [line for line in lines if "/8)" in line]
    for agent, right in (("good", "100.0 % (4/4)"), ("bad", "0.0 % (0/4)")):
        assert sum(line.startswith(f"{agent}: strict accuracy {right}") for line in lines) == 1
        assert sum(line.startswith(f"{agent}: open worlds: all predictions right {right}") for line in lines) == 1
    assert all(line.startswith(("good: ", "bad: ")) for line in lines)


def test_the_rungs_of_the_suite_are_easy_and_hard_and_packs_without_a_category_have_none() -> None:
    def row(category: str) -> ScoredEpisode:
        return scored(episode(), grade(right=category.startswith("hard")), category)

    names = ("easy-multi-hidden", "hard-single", "create-delete-attach", "uncategorised")
    summary = summarise([row(name) for name in names])
    assert {name: (group.n_correct, group.n) for name, group in summary.by_rung.items()} == {
        "easy": (0, 1),
        "hard": (1, 2),
        NO_RUNG: (0, 1),
    }
    assert "by rung  easy: 0.0 % (0/1)   hard: 50.0 % (1/2)   –: 0.0 % (0/1)" in summary_lines(summary, [])


def test_every_grouping_counts_every_episode_once() -> None:
    summary = summarise(
        [*rows(lambda _: True, agents=("x", "y")), *rows(lambda _: False, protocol="text", budgets=(5, 10))]
    )
    assert summary.overall.n == 48
    for name, groups in summary:
        if name.startswith("by_"):
            assert sum(group.n for group in groups.values()) == 48, name
    assert {name: group.n for name, group in summary.by_modality.items()} == {"hidden": 32, "plain": 16}
    assert {name: group.n for name, group in summary.by_problem_kind.items()} == {"qualitative": 24, "quantitative": 24}
    assert {name: group.n_correct for name, group in summary.by_protocol.items()} == {"native": 24, "text": 0}


@pytest.mark.parametrize(
    ("category", "expected"),
    [
        ("easy-single", "plain"),
        ("hard-multi-creation", "creation"),
        ("easy-multi-hidden", "hidden"),
        ("create-delete-attach", "create-delete-attach"),
        ("uncategorised", "uncategorised"),
        ("easy", "easy"),
    ],
)
def test_every_category_has_a_modality(category: str, expected: str) -> None:
    assert modality(category) == expected


def test_a_problem_type_is_qualitative_quantitative_or_other() -> None:
    kinds = [problem_kind(one) for one in ("comparison", "Observation ", "calculation", "computation", "estimation")]
    assert kinds == ["qualitative", "qualitative", "quantitative", "quantitative", "other"]


def test_a_budget_curve_uses_the_episodes_scored_at_every_budget() -> None:
    def right(key: EpisodeKey) -> bool | None:
        return None if (key.scene, key.budget) == (7, 10) else key.budget > 5 or key.scene < 9

    summary = summarise(rows(right, budgets=(20, 5, 10), agents=("y", "x")))
    assert [(one.agent, one.prompting, one.protocol) for one in summary.budget_curves] == [
        ("x", "zero-shot", "native"),
        ("y", "zero-shot", "native"),
    ]
    curve = summary.budget_curves[0].curve
    assert (curve.n, curve.n_scenes) == (11, 11)
    assert [(point.budget, point.accuracy.n_correct) for point in curve.points] == [(5, 1), (10, 11), (20, 11)]
    assert (curve.shape, curve.enough) == (CurveShape.RISING, 10)


def test_one_budget_or_no_common_episode_gives_no_curve() -> None:
    assert summarise(rows(lambda _: True)).budget_curves == ()
    apart = [*rows(lambda _: True, scenes=3), *rows(lambda _: True, scenes=6, budgets=(5,))[3:]]
    assert summarise(apart).budget_curves == ()


def test_conditions_with_several_attempts_at_each_scene_have_pass_at_k() -> None:
    summary = summarise(
        [
            *rows(lambda key: key.seed == 0, seeds=4),
            *rows(lambda _: True, agents=("once",)),
            *rows(lambda _: None, agents=("never",)),
        ]
    )
    (found,) = summary.attempts
    assert (found.agent, found.budget, found.attempts.n_scenes, found.attempts.tries) == ("x", 20, 12, 4)
    # One of four attempts succeeds on every scene; it is in half of the pairs of attempts.
    assert [(point.k, point.pass_at_k, point.pass_hat_k) for point in found.attempts.points] == [
        (1, 0.25, 0.25),
        (2, 0.5, 0),
        (4, 1, 0),
    ]


def test_the_summary_fits_its_published_schema_and_reads_back() -> None:
    summary = summarise(rows(lambda key: key.budget > 5, budgets=(5, 20), seeds=2))
    text = summary.model_dump_json()
    validator = Draft202012Validator(json.loads(SCHEMA.read_text(encoding="utf-8")))
    validator.validate(json.loads(text))  # pyright: ignore[reportUnknownMemberType] - partly typed
    assert RunSummary.model_validate_json(text) == summary


def test_the_terminal_shows_denominators_and_the_effect_of_the_budget() -> None:
    played = rows(lambda key: key.budget > 5, budgets=(5, 20))
    lines = summary_lines(summarise(played), played)
    assert "by budget  5: 0.0 % (0/12)   20: 100.0 % (12/12)" in lines
    assert (
        "accuracy is rising with the budget on 12 episodes of 12 scenes at each budget, with 99 % certainty;"
        " gains have not ended at 20" in lines
    )
    played = rows(lambda key: key.budget > 5, budgets=(5, 20), agents=("x", "y"))
    two = summary_lines(summarise(played), played)
    assert any(line.startswith("x, zero-shot, native: accuracy is rising") for line in two)


def test_a_flat_curve_is_described_with_its_certainty_unless_too_few_episodes_were_played() -> None:
    def told(scenes: int) -> str:
        return curve_sentence(budget_curve((5, 20), [Cell(scene, (scene < 3, scene < 3)) for scene in range(scenes)]))

    assert told(40) == (
        "no two budgets can be told apart on 40 episodes of 40 scenes at each budget; within 5 points with 99 %"
        " certainty; beyond 5 no budget gains more than 5 points, with 99 % certainty"
    )
    assert told(4) == (
        "no two budgets can be told apart on 4 episodes of 4 scenes at each budget;"
        " beyond 5 no budget gains more than 5 points"
    )


def test_the_command_starts_without_loading_scipy_stats_or_special() -> None:
    code = "import sys; from evaluator.commands.program import parsed; parsed(['run'])\n"
    code += "sys.exit(any(f'scipy.{x}' in sys.modules for x in ('stats', 'special')))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_stored_summary_of_an_earlier_version_reads_and_keeps_its_numbers() -> None:
    new = json.loads(summarise(rows(lambda key: key.scene % 2 == 0)).model_dump_json())
    assert (new["format"], new.pop("scoring_version")) == (3, SCORING_VERSION)
    for group in (new["overall"], *(one for name in new if name.startswith("by_") for one in new[name].values())):
        for name in ("skill", "skill_interval", "blind_accuracy", "gated", "blind_score", "n_numbers"):
            del group[name]
    read = RunSummary.model_validate({**new, "format": 2})
    assert (read.format, read.scoring_version, read.overall.skill) == (2, 1, None)
    assert read.overall.final_score == new["overall"]["final_score"]
