"""Tests that every printed Final Score is 100 times the weighted sum of the dimensions printed in its row."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from html.parser import HTMLParser

import pytest

from evaluator.commands.terminal import summary_lines
from evaluator.report.agent_results import Run, agent_results
from evaluator.report.agent_tables import paper_tables
from evaluator.report.export import csv_text, latex, markdown
from evaluator.report.page import paper_page, render
from evaluator.report.tables import tables
from evaluator.scores.dimensions import WEIGHTS
from evaluator.scores.metrics import summarise
from evaluator.scores.scored_episode import ScoredEpisode
from tests.builders.records import episode, episode_key, grade, refused, returned, turn
from tests.builders.reports import CATEGORIES, run_of
from tests.builders.scored import scored

TITLES = ("C", "E", "G", "V", "R", "G′")
SCORES = ("Final Score", "Score", "FS", "Avg. FS")
ROUNDING = 0.05 + 0.05
"""Largest rounding error of a score: 0.05 from its one decimal, and 0.05 from the three decimals of the six dimensions,
whose weights add up to 1."""
READ = returned("get_position", {"position": [0.0, 0.0, 1.951]}, object_id=1)


def row(number: int, agent: str) -> ScoredEpisode:
    """Return episode `number`: with an experiment unless 3 divides the number, with stated numbers if it is odd."""
    said = f"I read z = 1.951 m, so the mass is {number + 20.5} kg." if number % 2 else ""
    turns = [turn("I look.", READ, *[refused("step")] * (number % 4))] if number % 3 else []
    quiet = agent == "quiet" and number > 1
    turns += [turn("" if quiet else said, returned("answer"))]
    key = episode_key(7 + number, agent=agent, budget=(5, 20)[number % 2])
    shares = (0.0, 1.0, 0.5, 1.0, 1.0)
    found = grade(shares[number % 5] == 1, graded=shares[number % 5])
    # Two categories at each budget, for G′.
    return scored(episode(*turns, key=key), found, CATEGORIES[number % 4], "calculation")


@pytest.fixture(scope="module")
def run() -> Run:
    """A run of two agents: some episodes lack a dimension, and one agent writes too few numbers for G."""
    return run_of([row(number, agent) for agent in ("quiet", "model:x") for number in range(53)])


def number(cell: str) -> float | None:
    """The number at the start of a printed cell; None for a dash."""
    found = re.match(r"-?\d+(?:\.\d+)?|–|--", cell.strip())
    assert found is not None, cell
    return None if found[0] in {"–", "--"} else float(found[0])


def check(row: Mapping[str, str]) -> bool:
    """Recompute the scores of a printed row, identified by column titles; False if it contains none."""
    title = next((title for title in SCORES if title in row), None)
    if title is None or not set(TITLES) <= set(row):
        return False
    parts = dict(zip(WEIGHTS, (number(row[name]) for name in TITLES), strict=True))
    total = sum(100 * WEIGHTS[name] * (part or 0.0) for name, part in parts.items())
    printed = number(row[title])
    if printed is not None:
        assert printed == pytest.approx(total, abs=ROUNDING)
    if "FS*" in row:
        defined = sum(WEIGHTS[name] for name, part in parts.items() if part is not None)
        assert number(row["FS*"]) == pytest.approx(total / defined, abs=ROUNDING / defined)
    return printed is not None


def checked(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> int:
    """Recompute the scores of a printed table; returns the number of scores."""
    if not set(TITLES) <= set(titles):
        return 0
    # The second column V counts only enabled tools.
    names = [f"{title} again" if title in titles[:place] else title for place, title in enumerate(titles)]
    return sum(check(dict(zip(names, row, strict=True))) for row in rows)


class Tables(HTMLParser):
    """Parser of the table cells of a page, which ignores `<small>`."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.rows: list[list[list[str]]] = []
        self.small = self.inside = False
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "table":
            self.rows.append([])
        elif tag == "tr":
            self.rows[-1].append([])
        elif tag in {"td", "th"}:
            self.rows[-1][-1].append("")
            self.inside = True
        elif tag == "small":
            self.small = True

    def handle_endtag(self, tag: str) -> None:
        if tag in {"td", "th"}:
            self.inside = False
        elif tag == "small":
            self.small = False

    def handle_data(self, data: str) -> None:
        if self.inside and not self.small:
            self.rows[-1][-1][-1] += data.strip()


WORDS: dict[str, str] = dict(
    zip(
        ("graded correctness", "efficiency", "grounding", "valid calls", "non-repetition", "held-out accuracy"),
        TITLES,
        strict=True,
    )
)
"""Title of a dimension in the table of all dimensions → its letter in the other tables."""


def html_tables(page: str) -> int:
    tables = [table for table in Tables(page).rows if table]
    return sum(checked([WORDS.get(title, title) for title in table[0]], table[1:]) for table in tables)


def test_in_the_terminal(run: Run) -> None:
    found = 0
    for agent in ("quiet", "model:x"):
        rows = [row for row in run.rows if row.key.agent == agent]
        for line in summary_lines(summarise(rows), rows):
            parts = dict(part.rsplit(" ", 1) for part in re.sub(r" \([^)]*\)", "", line).split("   ") if " " in part)
            found += check(parts)
    assert found == 2


def test_in_markdown_csv_and_latex(run: Run) -> None:
    ours = tables(agent_results([run]))
    for part in markdown(ours).split("## ")[1:]:
        lines = [line for line in part.splitlines() if line.startswith("|")]
        titles, _, *rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
        assert checked(titles, rows) == (2 if part.startswith("Six dimensions") else 0)
    (dimensions,) = (table for table in ours if table.name == "six_dimensions")
    titles, *rows = [line.split(",") for line in csv_text(dimensions).splitlines()]
    assert checked(titles, [[cell or "–" for cell in row] for row in rows]) == 2
    lines = [line.strip().removesuffix("\\\\").strip() for line in latex([dimensions]).splitlines() if " & " in line]
    titles, *rows = [[cell.strip().replace("$'$", "′") for cell in line.split("&")] for line in lines]
    assert checked(titles, rows) == 2


def test_on_the_page_in_every_group(run: Run) -> None:
    # Both agents as a whole, and in each category, quadrant, problem type and budget that has a G′.
    assert html_tables(render([run]).page) == 2 * (1 + 4 + 4 + 1 + 2)


def test_in_the_layout_of_the_paper_with_the_paper_s_own_rows(run: Run) -> None:
    assert html_tables(paper_page("x", paper_tables(agent_results([run])))) == 2 + 7


def groups(value: object) -> Iterator[Mapping[str, float | None]]:
    """Return every group in a summary, at any depth."""
    if isinstance(value, dict):
        if "final_score" in value:
            yield value
        for inner in value.values():
            yield from groups(inner)


def test_in_json_to_the_last_digit(run: Run) -> None:
    found = list(groups(json.loads(summarise(run.rows).model_dump_json())))
    assert len(found) > 12
    for group in found:
        if group["final_score"] is not None:
            total = sum(100 * weight * (group[name] or 0.0) for name, weight in WEIGHTS.items())
            assert group["final_score"] == pytest.approx(total, rel=1e-12)


def test_g_has_its_denominator_and_needs_twenty_numbers(run: Run) -> None:
    quiet, model = (agent_results([run])[place].whole for place in (1, 0))
    assert (quiet.g, quiet.n_numbers, quiet.n_defined["g"]) == (None, 2, 1)
    rows = [row for row in run.rows if row.key.agent == "quiet"]
    lines = summary_lines(summarise(rows), rows)
    told = "– (2 numbers in 1 of 53 episodes)"
    assert any(f"   G {told}   G+ {told}   " in line for line in lines)
    # Each of 26 odd episodes states two numbers; the first is supported if the episode has an experiment.
    assert (model.n_numbers, model.n_defined["g"]) == (52, 26)
    assert model.g == pytest.approx(sum(number % 3 > 0 for number in range(1, 53, 2)) / 52)
    assert model.v is not None
    page = render([run]).page
    assert "– <small>2 numbers in 1 of 53 episodes</small>" in page
    assert "<small>defined in 35 of 53 episodes</small>" in page
