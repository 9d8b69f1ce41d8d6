"""Tests of evidence in a report: counts of verdicts, scatter plots and curves, for measured episodes only."""

from dataclasses import replace
from pathlib import Path

import pytest

from evaluator.records.evidence import CallEvidence, EvidenceRecord, EvidenceVerdict, Rival
from evaluator.report.agent_results import Run, agent_results
from evaluator.report.charts import TOP
from evaluator.report.evidence import PLANE, evidence_charts, evidence_table, planes
from evaluator.report.page import render, write_report
from evaluator.scores.metrics import summarise
from evaluator.scores.scored_episode import ScoredEpisode
from evaluator.store.run_folder import RunFolder
from tests.builders.chromium import Page
from tests.builders.reports import played, run_of


def measured(row: ScoredEpisode, *bounds: float, rivals: int = 0) -> ScoredEpisode:
    """Add evidence to an episode: one call for each of the bounds, with that bound after it."""
    calls = tuple(
        CallEvidence(turn=1 + n // 2, call=n + 1, bounds=(bound,), rivals=rivals, bits=n)
        for n, bound in enumerate(bounds)
    )
    return replace(row, evidence=EvidenceRecord(key=row.key, episode="0", calls=calls))


@pytest.fixture(scope="module")
def run() -> Run:
    """A run of the reference and a model. The model has each verdict of evidence once, and an unmeasurable episode."""
    model = [played(scene, "model:x", 20, right=scene % 2 == 0) for scene in range(7, 12)]
    unmeasurable = EvidenceRecord(key=model[4].key, episode="0", not_measurable="a formula")
    rows = [
        measured(model[0], 3.0, 0.8),
        measured(model[1], 3.0, 2.0, 0.2, 0.1),
        measured(model[2], 0.3, 0.1),
        measured(model[3], 3.0),
        replace(model[4], evidence=unmeasurable),
        measured(played(8, "reference", 20, right=True), 0.4),
    ]
    return run_of(rows)


def test_the_table_counts_verdicts_and_compares_calls_with_the_reference(run: Run) -> None:
    table = evidence_table(agent_results([run]))
    assert table is not None
    model = dict(zip(table.columns, table.rows[0], strict=True))
    assert [model[verdict] for verdict in map(str, EvidenceVerdict)] == [1, 1, 1, 1]
    assert model["not measurable"] == 1
    assert model["answers given before the evidence"] == 2
    assert model["calls until it sufficed"] == 2  # 3 in scene 8 and 1 in scene 9
    assert model["times the reference's"] == 3
    assert model["calls after it sufficed"] == 2  # of four calls


def test_a_summary_counts_the_verdicts_and_omits_them_where_nothing_was_measured(run: Run) -> None:
    found = summarise(run.rows).overall.evidence
    assert found is not None
    assert found.verdicts[EvidenceVerdict.EARNED] == 2
    assert '"evidence"' not in summarise([replace(row, evidence=None) for row in run.rows]).model_dump_json()


def test_a_report_without_evidence_does_not_mention_it(run: Run) -> None:
    page = render([replace(run, rows=[replace(row, evidence=None) for row in run.rows])]).page
    for word in ("Evidence</", "data-evidence=", "sufficed", "data-calls", 'class="chart plane"'):
        assert word not in page
    assert "data-evidence=" in render([run]).page


def test_the_curve_marks_the_call_that_sufficed_and_counts_the_calls_of_the_film(run: Run) -> None:
    (curve,) = evidence_charts(run.rows[1])
    assert curve.flag is not None
    assert curve.flag.label == "sufficed at call 3"
    bound, enough = curve.lines
    crossed = [mark.y > enough.marks[0].y for mark in bound.marks]  # downwards on the page
    assert crossed == [False, False, True, True]
    assert curve.flag.at == bound.marks[2].x
    assert curve.calls == [1, 2, 3, 4]
    assert [tick.label for tick in curve.y_ticks] == ["0.1", "1", "10"]
    assert evidence_charts(replace(run.rows[1], evidence=None)) == []


def test_right_answers_lie_above_wrong_ones_and_sufficient_evidence_to_the_right(run: Run) -> None:
    rows = [(number, 0, row) for number, row in enumerate(run.rows[:5], start=1)]
    (plane,) = planes(agent_results([run]), rows)
    assert plane.left_out == 1
    for dot in plane.dots:
        enough = dot.verdict in {EvidenceVerdict.EARNED, EvidenceVerdict.INFERENCE_FAILED}
        right = dot.verdict in {EvidenceVerdict.EARNED, EvidenceVerdict.GUESSED}
        assert (dot.x > plane.sufficient) == enough
        assert (dot.y < PLANE[1] / 2) == right
    assert len({dot.number for dot in plane.dots}) == 4


def test_many_equal_episodes_stay_in_their_lane_and_apart() -> None:
    rows = [measured(played(8, "model:x", 20, right=True, seed=seed), 0.1) for seed in range(30)]
    (plane,) = planes(agent_results([run_of(rows)]), [(n, 0, row) for n, row in enumerate(rows)])
    heights = sorted(dot.y for dot in plane.dots)
    assert len(set(heights)) == 30
    assert heights[0] > TOP


@pytest.mark.parametrize(
    ("choice", "rivals", "suffices"), [(1.0, 0, True), (0.95, 0, True), (0.94, 0, False), (1.0, 1, False)]
)
def test_what_is_no_number_has_a_bound_that_suffices_when_it_does(choice: float, rivals: int, suffices: bool) -> None:
    found = CallEvidence(turn=1, call=1, bounds=(), choice=choice, rivals=rivals, bits=0)
    assert found.suffices == suffices
    assert (found.worst_bound <= 0.5) == suffices


def test_a_law_that_is_not_excluded_makes_the_evidence_of_the_episode_weak() -> None:
    row = measured(played(8, "model:x", 20, right=True), 0.1)
    assert row.evidence is not None
    assert row.evidence.worst_bound == 0.1
    possible = row.evidence.model_copy(update={"rivals": (Rival(name="other", chi_square=1, excluded=False),)})
    assert not possible.suffices
    assert possible.worst_bound is not None
    assert possible.worst_bound > 0.5


@pytest.mark.parametrize(
    ("count", "sentence"),
    [
        (1, "guessed right without evidence; not excluded: law 0</dd>"),
        (5, "not excluded: law 0, law 1, law 2, law 3, law 4</dd>"),
        (7, "not excluded: law 0, law 1, law 2, law 3, law 4 and 2 more</dd>"),
    ],
)
def test_a_report_names_at_most_five_laws_that_are_not_excluded(count: int, sentence: str) -> None:
    row = measured(played(8, "model:x", 20, right=True), 0.1)
    assert row.evidence is not None
    excluded = Rival(name="excluded", chi_square=50, excluded=True)
    rivals = [Rival(name=f"law {number}", chi_square=1, excluded=False) for number in range(count)]
    evidence = row.evidence.model_copy(update={"rivals": (excluded, *rivals)})
    assert sentence in render([run_of([replace(row, evidence=evidence)])]).page


@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (390, "dark")])
def test_planes_fit_the_window_lead_to_episodes_and_the_list_filters_by_verdict(
    browser: Page, run: Run, tmp_path: Path, width: int, scheme: str
) -> None:
    browser.complaints.clear()
    browser.look(width, scheme)
    browser.open(write_report(RunFolder(tmp_path), [run]))
    assert browser.run("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
    browser.run(
        "(() => { const one = document.getElementById('evidence-verdict'); one.value = 'guessed right without"
        " evidence'; one.dispatchEvent(new Event('change')); })()"
    )
    assert browser.run("document.querySelectorAll('#list > details').length") == 1
    href = browser.run("document.querySelector('.plane a').getAttribute('href')")
    browser.run("document.querySelector('.plane a').dispatchEvent(new MouseEvent('click', {bubbles: true}))")
    browser.run(f"location.hash = '{href}'")
    browser.wait(f"document.querySelector('{href}')?.open")
    assert browser.complaints == []
