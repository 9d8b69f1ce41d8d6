"""Tests of the calibration: coverage of intervals, values computed by hand, and one-sentence errors for bad input."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from evaluator.calibration.model import FEATURES, _Posterior, counted_responses, features_of, fit, responses
from evaluator.calibration.pages import calibration_page, calibration_tables, calibration_text, person_item_map
from evaluator.calibration.results import calibrate, components
from evaluator.errors import UsageError
from evaluator.records.calibration import DETECTED, Calibration
from evaluator.records.episode import GradeRecord, Verdict
from evaluator.store.run_folder import RunFolder
from tests.builders.commands import physment_eval
from tests.builders.records import episode_key, grade
from tests.evaluator.study.test_stored_run import PACKS, STORED
from tests.harness.calibration.coverage import DESIGNS, Design, covered, drawn


def record(taker: str, scene: int, *, right: bool | None, seed: int = 0, pack: str = "p") -> GradeRecord:
    return GradeRecord(
        key=episode_key(scene, seed=seed, agent=taker),
        grade=grade(right),
        answer_key=1,
        grader_version="4",
        pack_version=pack,
    )


def test_intervals_of_simulated_takers_cover() -> None:
    """Runs a smaller simulation than `tests/harness/calibration/coverage.py`, which gives the published figure."""
    source, found = np.random.default_rng(1), list[bool]()
    for design in DESIGNS[:2]:
        for _ in range(8):
            abilities, difficulties = covered(drawn(design, source))
            found += [*abilities, *difficulties]
    # The takers of a replication share the error of the scale, so the share varies more than for independent intervals.
    assert 0.92 < np.mean(found) < 0.98


def test_a_fit_of_twenty_agents_105_scenes_and_five_seeds_finds_what_was_put_in() -> None:
    one = drawn(Design(20), np.random.default_rng(2))
    found = fit(one.data, one.features)
    assert np.corrcoef(found.ability, one.ability)[0, 1] > 0.98
    assert np.corrcoef(found.difficulty, one.difficulty)[0, 1] > 0.95
    assert (found.spreads.scene, found.spreads.variant) == (pytest.approx(1.2, rel=0.25), pytest.approx(0.6, rel=0.3))
    assert found.effect == pytest.approx([0.8, -0.4, 0.0], abs=0.45)


def test_with_the_same_answers_to_every_scene_abilities_are_those_of_logistic_regression() -> None:
    # If scenes do not differ, an ability is the logit of the share of right answers; the prior shifts it towards 0.
    counts = {("a", scene, 0): (int(scene < 300), 1) for scene in range(400)}
    counts |= {("b", scene, 0): (int(scene % 2 == 0), 1) for scene in range(400)}
    found = fit(counted_responses(counts), np.zeros((400, 1)))
    assert found.ability[0] - found.ability[1] == pytest.approx(math.log(3), abs=0.15)
    assert found.ability_se[0] == pytest.approx((400 * 0.75 * 0.25) ** -0.5, rel=0.2)


def test_the_gradient_is_that_of_the_density() -> None:
    one = drawn(Design(4, scenes=12, seeds=2), np.random.default_rng(3))
    posterior = _Posterior(one.data, one.features)
    at = np.random.default_rng(4).normal(0, 0.3, posterior.size)
    steps = 1e-5 * np.eye(posterior.size)
    differences = [(posterior.at(at + step).loss - posterior.at(at - step).loss) / 2e-5 for step in steps]
    assert posterior.at(at).gradient == pytest.approx(np.array(differences), abs=1e-6)


def test_the_grid_integrates_as_quadrature_does() -> None:
    # One scene with two variants. Adaptive quadrature integrates over the scene's rest and the variants' deviations.
    data = counted_responses({("a", 1, 0): (1, 1), ("b", 1, 0): (0, 1), ("a", 1, 1): (2, 3), ("b", 1, 1): (1, 1)})
    posterior = _Posterior(data, np.zeros((1, 1)))
    parameters = np.array([0.7, -0.4, 0.0, math.log(1.2), math.log(0.6)])

    def likelihood(ability: float, right: int, count: int, at: float) -> float:
        chance = 1 / (1 + math.exp(at - ability))
        return chance**right * (1 - chance) ** (count - right)

    def of_variant(seed: int, rest: float) -> float:
        cells = [(0.7, 1, 1), (-0.4, 0, 1)] if seed == 0 else [(0.7, 2, 3), (-0.4, 1, 1)]
        return quad(lambda e: norm.pdf(e) * math.prod(likelihood(*cell, rest + 0.6 * e) for cell in cells), -8, 8)[0]

    integral = quad(lambda u: norm.pdf(u) * of_variant(0, 1.2 * u) * of_variant(1, 1.2 * u), -8, 8)[0]
    priors = math.log(1.2) + math.log(0.6) - (0.7**2 + 0.4**2) / 18
    assert -posterior.at(parameters).loss == pytest.approx(math.log(integral) + priors, abs=2e-4)


def test_variance_components_by_hand() -> None:
    # Two takers, two scenes, two seeds: in scene 1, a is right and b is wrong; in scene 2, both are wrong.
    right = {("a", 1): 1, ("b", 1): 0, ("a", 2): 0, ("b", 2): 0}
    data = counted_responses({(t, s, v): (one, 1) for (t, s), one in right.items() for v in (0, 1)})
    found = components(data)
    assert found is not None
    # The interaction is ±1/4 in all four cells: mean square 2 · (4/16) / 1 = 1/2, variance 1/2 / 2. Variants are equal.
    assert found[:3] == (pytest.approx(0.25), 0.0, 0.0)
    assert found.smallest_difference(100, 2, 1) == pytest.approx(DETECTED * (2 * 0.25 / 100) ** 0.5)
    once = counted_responses({("a", 1, 0): (1, 2), ("b", 1, 0): (0, 2), ("a", 2, 0): (1, 2), ("b", 2, 0): (2, 2)})
    found = components(once)
    assert found is not None
    assert (found.epoch, found.epochs, found.taker_variant) == (pytest.approx((0.5 + 0 + 0.5 + 0) / 4), 2, 0.0)
    assert components(counted_responses({("a", 1, 0): (1, 1), ("b", 2, 0): (1, 1)})) is None


@pytest.fixture(scope="module")
def found() -> Calibration:
    """Calibrate six takers and twelve scenes; in the last scene, weak takers are right and able takers are wrong."""
    one = drawn(Design(6, scenes=12, seeds=5, ability_sd=2.0), np.random.default_rng(4))
    able = one.ability > np.median(one.ability)
    counts: dict[tuple[str, int, int], tuple[int, int]] = {
        (str(one.data.takers[t]), one.data.scenes[s], one.data.variants[v][1]): (int(right), 1)
        for t, s, v, right in zip(one.data.taker, one.data.scene, one.data.variant, one.data.right, strict=True)
    }
    counts |= {(taker, 11, v): (int(not able[t]), 1) for t, taker in enumerate(one.data.takers) for v in range(5)}
    features = np.hstack([one.features, np.zeros((12, len(FEATURES) - 3))])
    return calibrate(counted_responses(counts), features, ["easy", "hard"] * 6)


def test_a_scene_that_the_able_get_wrong_is_listed(found: Calibration) -> None:
    assert [scene.scene for scene in found.scenes if scene.is_doubtful] == [11]
    doubtful = next(scene for scene in found.scenes if scene.scene == 11)
    assert doubtful.separation is not None
    assert doubtful.separation < -0.5
    assert doubtful.infit == max(scene.infit for scene in found.scenes)
    assert np.mean([scene.infit for scene in found.scenes if scene.scene != 11]) == pytest.approx(1, abs=0.35)


def test_the_map_the_text_and_the_page_show_everybody(found: Calibration) -> None:
    drawn_map, text, page = person_item_map(found), calibration_text(found), calibration_page("a <b>", found)
    for taker in found.takers:
        assert taker.name in drawn_map
        assert f"| {taker.name} | {taker.right} | {taker.answers} | {taker.logits:.2f} | {taker.se:.2f} |" in text
    assert {int(one) for line in drawn_map.splitlines()[1:] for one in line.split("|")[2].split()} == set(range(12))
    assert page.count("<circle") == 6 + 12
    assert "a &lt;b&gt;: calibration" in page
    assert [table.name for table in calibration_tables(found)][-1] == "difficulties"
    assert Calibration.model_validate_json(found.model_dump_json()) == found
    assert [one.feature for one in found.effects] == list(FEATURES[:3])


def test_features_come_from_packs_and_certificates_and_are_standardised() -> None:
    table = features_of([7, 26, 57, 101])
    assert table.shape == (4, len(FEATURES))
    assert table.mean(axis=0) == pytest.approx(np.zeros(len(FEATURES)))
    assert {round(float(spread), 6) for spread in table.std(axis=0)} <= {0.0, 1.0}
    assert table[:, FEATURES.index("hard")].argmax() == 1


@pytest.mark.parametrize(
    ("runs", "sentence"),
    [
        ({}, "no graded episode"),
        ({"one": [record("a", 7, right=None)]}, "no graded episode"),
        ({"one": [record("a", 7, right=True), record("a", 8, right=False)]}, "only a was played"),
        ({"one": [record("a", 7, right=True)], "two": [record("b", 7, right=True)]}, "all 2 answers are right"),
        ({"one": [record("a", 7, right=False), record("b", 7, right=False)]}, "all 2 answers are wrong"),
        (
            {"one": [record("a", 7, right=True)], "two": [record("b", 7, right=False, pack="q")]},
            "one and two were played on different packs of scene 7",
        ),
    ],
)
def test_bad_input_is_refused_in_one_sentence(runs: dict[str, list[GradeRecord]], sentence: str) -> None:
    with pytest.raises(UsageError, match=sentence) as refused:
        responses(runs)
    assert "\n" not in str(refused.value)


def test_an_agent_at_two_budgets_is_two_takers() -> None:
    one = record("a", 7, right=True)
    other = one.model_copy(update={"key": one.key.model_copy(update={"budget": 5}), "grade": grade(right=False)})
    assert responses({"x": [one, other]}).takers == ["a (budget 20)", "a (budget 5)"]


def test_the_command_calibrates_a_stored_run_and_refuses_what_it_cannot_use(tmp_path: Path) -> None:
    done = physment_eval("calibrate", STORED, "--scenes-dir", PACKS, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    assert "## Abilities" in done.stdout
    stored = json.loads((tmp_path / "out" / "calibration.json").read_text(encoding="utf-8"))
    verdicts = [one.grade.strict for one in RunFolder(STORED).grades().values()]
    assert sum(one["answers"] for one in stored["takers"]) == len(verdicts)
    assert sum(one["right"] for one in stored["takers"]) == verdicts.count(Verdict.CORRECT)
    for words, said in (([tmp_path], "is not a run folder"), ([STORED], "on another pack of scene"), ([], "DIR")):
        done = physment_eval("calibrate", *words)
        assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
        assert said in done.stderr
