"""Tests of the tables in the paper's layout: rows, order, colours, and marks of numbers quoted from the paper."""

import re

import pytest

from evaluator.report.agent_results import BUDGETS, CATEGORIES, PAPER, REGRADED, Run, agent_results
from evaluator.report.agent_tables import MARK, bucket, heat_map, paper_tables
from evaluator.report.page import paper_page
from evaluator.report.tables import Share, Table
from evaluator.scores.dimensions import final_score
from scenes import Category


def found(run: Run) -> dict[str, Table]:
    return {table.name: table for table in paper_tables(agent_results([run]))}


def test_the_paper_s_numbers_agree_with_each_other() -> None:
    for model in PAPER:
        assert round(final_score(*model.dimensions), 1) == model.final_score
        assert len(model.accuracy) == len(BUDGETS)
        assert len(model.by_category) == len(CATEGORIES)
    assert sum(cases for cases, _ in REGRADED.values()) == 150


def test_the_heat_map_has_the_paper_s_categories_and_no_open_worlds(study: Run) -> None:
    assert list(CATEGORIES) == [category for category in Category if category is not Category.OPEN]
    table = heat_map(agent_results([study]))
    assert [row[0] for row in table.rows] == list(CATEGORIES.values())
    assert [column.endswith(MARK) for column in table.columns[-7:]] == [True] * 7
    gpt = table.columns.index("GPT-5.5" + MARK)
    first = table.rows[0][gpt]
    assert isinstance(first, Share)
    assert first.value == pytest.approx(0.806)


@pytest.mark.parametrize(
    ("share", "name"),
    [
        (0, "low"),
        (0.1994, "low"),
        (0.2, "mid-low"),
        (0.399, "mid-low"),
        (0.4, "mid"),
        (0.6, "high"),
        (0.8, "top"),
        (1, "top"),
    ],
)
def test_an_accuracy_has_the_colour_of_its_bucket(share: float, name: str) -> None:
    assert bucket(share).name == name


def test_our_agents_stand_before_the_paper_s_models_in_every_table(study: Run) -> None:
    tables = found(study)
    ours = [result.label for result in agent_results([study])]
    assert [row[0] for row in tables["paper_metrics"].rows][: len(ours)] == ours
    assert [row[0] for row in tables["paper_dimensions"].rows][len(ours) :] == [model.model + MARK for model in PAPER]
    assert tables["paper_overall"].columns[1 : 1 + len(ours)] == tuple(ours)
    assert {row[0] for row in tables["paper_overall"].rows} >= {"5", "10", "15", "20"}
    assert [row[-2:] for row in tables["paper_regraded"].rows] == [list(pair) for pair in REGRADED.values()]


def test_the_page_shows_every_table_and_what_the_mark_means(study: Run) -> None:
    page = paper_page("study", paper_tables(agent_results([study])))
    assert re.findall(r'<table id="(\w+)">', page) == list(found(study))
    assert "† printed in the paper, measured on the paper's scenes" in page
    assert '<td class="top">80.6</td>' in page
