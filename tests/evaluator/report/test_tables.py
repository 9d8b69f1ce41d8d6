"""Tests of the content of tables, exports and figures, and of their safety for programs that read them."""

import csv
import io
import re
import sys
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from evaluator.errors import UsageError
from evaluator.report.agent_results import PAPER, Run, agent_results
from evaluator.report.export import csv_text, latex, markdown
from evaluator.report.figures import write_figures
from evaluator.report.page import render
from evaluator.report.tables import Count, Share, by_budget, by_category, group_picks, tables
from evaluator.scores.scored_episode import ScoredEpisode
from evaluator.scores.spending import spending
from evaluator.scores.wording import curve_sentence
from scenes import LabLimits
from tests.builders.records import grade
from tests.builders.reports import played, run_of
from tests.builders.scored import scored

EVIL = "=x|<b>&\\input{/etc/passwd}$_^\n%"


def hostile() -> Run:
    return run_of([played(scene, EVIL, budget, right=scene == 7) for scene in (7, 8) for budget in (5, 20)])


def test_agents_under_test_come_first_and_the_baselines_last(study: Run) -> None:
    other = run_of(
        [played(7, agent, 5, right=False) for agent in ("blind-constant", "zeta", "random", "reference")], "b"
    )
    names = [one.label for one in agent_results([other, study])]
    assert names == ["model:x", "zeta", "reference (b)", "reference (study)", "random", "blind-constant"]
    assert [one.is_baseline for one in agent_results([other, study])] == [False, False, True, True, True, True]


def test_the_attackers_are_baselines_too_and_agents_with_such_names_are_not() -> None:
    attackers = ["attacker:sweep", "attacker:glance", "attacker:proportional"]
    names = [*attackers, "random", "attacker:mine", "my-attacker:sweep"]
    found = agent_results([run_of([played(7, name, 5, right=False) for name in names])])
    assert [one.agent for one in found] == ["attacker:mine", "my-attacker:sweep", "random", *attackers]
    assert [one.is_baseline for one in found] == [False, False, True, True, True, True]


def open_world(scene: int, agent: str, *, graded: float) -> ScoredEpisode:
    """Return an episode in an open world whose scene allows 10 calls."""
    row = played(scene, agent, 20, right=graded == 1)
    return scored(row.episode, grade(graded == 1, graded=graded), "open", limits=LabLimits(calls=10))


def test_open_worlds_have_rows_of_their_own_and_change_no_other_table(study: Run) -> None:
    worlds = [open_world(201 + number, "model:x", graded=share) for number, share in enumerate((1.0, 2 / 3))]
    mixed = run_of([*study.rows, *worlds])
    before, after = ({table.name: table for table in tables(agent_results([run]))} for run in (study, mixed))
    assert {name for name, table in after.items() if table != before[name]} == {"by_rung", "experiment_cost"}
    table = after["by_rung"]
    assert table.columns == ("agent", "easy", "hard", "open: all predictions right", "open: predictions right")
    shares = [
        [cell and cell[:1] + cell[3:] for cell in row if not isinstance(cell, str | int | float)] for row in table.rows
    ]
    assert shares == [
        [(0.5, 16), (0.5, 16), (0.5, 2), (pytest.approx(5 / 6), 2)],
        [(1.0, 16), (1.0, 16), None, None],
    ]


def test_costs_of_experiment_are_medians_for_each_agent_in_the_suite_and_on_each_rung(study: Run) -> None:
    mixed = run_of([*study.rows, open_world(201, "model:x", graded=1.0), open_world(202, "new", graded=0.0)])
    table = next(one for one in tables(agent_results([mixed])) if one.name == "experiment_cost")
    assert [(row[0], row[1], row[2]) for row in table.rows] == [
        ("model:x", "all", 32),
        ("model:x", "easy", 16),
        ("model:x", "hard", 16),
        ("model:x", "open", 1),
        ("new", "open", 1),
        ("reference", "all", 32),
        ("reference", "easy", 16),
        ("reference", "hard", 16),
    ]
    assert list(table.rows[0][3:]) == [4, 0, 0.2, None, None]
    assert list(table.rows[3][3:]) == [4, 0, 0.2, Share(0.4, None, None, 1), None]
    assert "| model:x | open | 1 | 4 | 0 | 0.20 | 40.0 | – |" in markdown([table])
    head, *_, last = csv.reader(io.StringIO(csv_text(table)))
    assert head[6:10] == ["of call limit", "of call limit low", "of call limit high", "of call limit n"]
    assert last == ["reference", "hard", "16", "4", "0", "0.2", "", "", "", "", ""]


def test_a_run_of_open_worlds_alone_has_no_tables_and_figures_of_the_suite(tmp_path: Path) -> None:
    found = agent_results([run_of([open_world(201, "model:x", graded=1.0)])])
    assert [table.name for table in tables(found)] == ["paper_by_budget", "by_rung", "experiment_cost"]
    assert write_figures(tmp_path, found, "svg") == []


def test_accuracies_by_budget_and_category_are_those_of_the_episodes(study: Run) -> None:
    who = agent_results([study])
    model, reference = by_budget(who).rows
    assert model[:1] == ["model:x"]
    assert [cell.value for cell in model[1:] if isinstance(cell, Share)] == [0.5, 0.5]
    assert isinstance(reference[1], Share)
    assert reference[1].low == pytest.approx(16 / (16 + 1.959964**2))  # Wilson's interval of 16 of 16
    assert (reference[1].value, reference[1].high, reference[1].n) == (1.0, 1.0, 16)
    categories = {row[0]: row[1] for row in by_category(who).rows}
    assert list(categories) == ["easy-multi-hidden", "easy-single", "hard-multi", "hard-single"]
    assert isinstance(categories["hard-single"], Share)
    assert (categories["hard-single"].value, categories["hard-single"].n) == (0.5, 8)


def test_the_page_describes_a_budget_curve_as_the_terminal_does(study: Run) -> None:
    (curve,) = agent_results([study])[0].summary.budget_curves
    page = render([study]).page.replace("\N{NO-BREAK SPACE}", " ")
    assert f"<li><b>model:x</b>: {curve_sentence(curve.curve)}.</li>" in page


def test_a_group_of_categories_includes_its_modalities(study: Run) -> None:
    picks = dict(group_picks(agent_results([study])))
    assert list(picks) == ["all", "easy-single", "easy-multi", "hard-single", "hard-multi"]
    easy_multi = picks["easy-multi"]
    assert easy_multi is not None
    assert {row.category for row in study.rows if easy_multi(row)} == {"easy-multi-hidden"}


def test_failure_modes_are_counted_among_the_scored_episodes(study: Run) -> None:
    table = next(one for one in tables(agent_results([study])) if one.name == "failure_modes")
    assert {str(row[0]): row[1:] for row in table.rows}["answer format mismatch"] == [Count(16, 32), Count(0, 32)]


def test_the_paper_is_quoted_with_seven_models_and_without_intervals() -> None:
    assert len(PAPER) == 7
    assert all(len(one.accuracy) == 4 for one in PAPER)
    assert "GPT-5.5 | 51.4 | 49.5 | 48.6 | 50.5" in markdown(tables([]))


def test_every_row_of_a_markdown_table_has_as_many_cells_as_the_titles() -> None:
    for part in re.split(r"^## .*$", markdown(tables(agent_results([hostile()]))), flags=re.MULTILINE)[1:]:
        rows = [re.split(r"(?<!\\)\|", line) for line in part.splitlines() if line.startswith("|")]
        assert len({len(row) for row in rows}) == 1
    assert "<b>" not in markdown(tables(agent_results([hostile()])))


def test_the_name_of_an_agent_is_no_latex_command(study: Run) -> None:
    text = latex(tables(agent_results([hostile()])))
    assert "\\input" not in text
    assert "=x|<b>\\&\\textbackslash{}input\\{/etc/passwd\\}\\$\\_\\textasciicircum{} \\%" in text
    assert text.count("\\begin{") == text.count("\\end{")
    rows = [line for line in latex(tables(agent_results([study]))).splitlines() if line.endswith("\\\\")]
    assert all(line.startswith("    ") for line in rows)


def test_csv_keeps_full_precision_and_holds_no_formula(study: Run) -> None:
    table = by_budget(agent_results([study]))
    head, model, _ = csv.reader(io.StringIO(csv_text(table)))
    assert head == ["agent", *(f"{budget}{what}" for budget in (5, 20) for what in ("", " low", " high", " n"))]
    share = table.rows[0][1]
    assert isinstance(share, Share)
    assert [float(one) for one in model[1:5]] == [share.value, share.low, share.high, share.n]
    rows = list(csv.reader(io.StringIO(csv_text(by_budget(agent_results([hostile()]))))))
    assert rows[1][0].startswith("'=x")
    assert {len(row) for row in rows} == {9}


def test_spending_is_reported_with_its_numbers_of_episodes(study: Run) -> None:
    model = spending([row for row in study.rows if row.episode.key.agent == "model:x"])
    assert (model.n, model.n_metered, model.n_priced, model.input_tokens) == (32, 32, 32, 32_000)
    assert model.cost_usd == pytest.approx(0.32)
    assert model.cost_per_correct_usd == pytest.approx(0.02)
    assert (model.iterations, model.calls) == (2, 4)
    assert model.agent_turn is not None
    assert (model.agent_turn.median, model.agent_turn.p95) == (2.5, 3.0)
    nothing = spending([])
    assert (nothing.cost_usd, nothing.iterations, nothing.episode) == (None, None, None)


@pytest.mark.parametrize("form", ["svg", "pdf"])
def test_figures_are_complete_files_and_equal_each_time(tmp_path: Path, study: Run, form: str) -> None:
    who = agent_results([study, hostile()])
    files = write_figures(tmp_path / "a", who, form)
    assert [file.stem for file in files] == ["budget", "categories", "dimensions", "failure_modes"]
    again = write_figures(tmp_path / "b", who, form)
    assert [one.read_bytes() for one in files] == [one.read_bytes() for one in again]
    if form == "svg":
        assert all(ET.parse(file).getroot().tag.endswith("svg") for file in files)
        assert "model:x" in files[0].read_text(encoding="utf-8")


def test_without_the_plotting_library_an_error_says_what_to_install(
    tmp_path: Path, study: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(UsageError, match=r"pip install physment-mcp\[report\]"):
        write_figures(tmp_path, agent_results([study]), "svg")
