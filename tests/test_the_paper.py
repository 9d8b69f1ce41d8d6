"""Tests of the page that compares the project with the paper: it is complete, and names only existing things."""

import json
import re
from collections import Counter

from evaluator.report.agent_results import BUDGETS
from evaluator.scores.grouping import QUALITATIVE, QUANTITATIVE, problem_kind
from evaluator.study.selection import parse_scenes
from scenes import AnswerKind, Category, Pack, read_pack
from tests.builders.paths import DOCS, ROOT

PAGE = DOCS / "explanation" / "the-paper.md"
STATUS = {"as in the paper", "as in the paper, and more", "different", "ambiguous", "not here"}


def rows() -> list[list[str]]:
    lines = re.findall(r"^\| \d.*\|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def numbers(row: list[str]) -> range:
    """Parse the numbers of the paper's statements in a row: `43–45` means three."""
    first, _, last = row[0].partition("–")
    return range(int(first), int(last or first) + 1)


def test_every_statement_has_a_row_and_a_status() -> None:
    found = rows()
    assert [number for row in found for number in numbers(row)] == list(range(1, 151))
    assert {row[2] for row in found} == STATUS
    assert len({row[1] for row in found}) == len(found)


def test_what_is_different_or_not_here_is_argued_for() -> None:
    for row in rows():
        if row[2] in {"different", "ambiguous", "not here"}:
            assert len(row[3]) > 40, row


def test_every_place_named_exists() -> None:
    for row in rows():
        (target,) = re.findall(r"\]\(([^)]+)\)", row[4])
        assert (PAGE.parent / target).resolve().is_relative_to(ROOT), row
        assert (PAGE.parent / target).exists(), row


def test_the_numbers_in_its_introduction_are_those_of_its_rows() -> None:
    text, found = PAGE.read_text(encoding="utf-8"), rows()
    for status in STATUS:
        count = sum(len(numbers(row)) for row in found if row[2] == status)
        words = {"different": "different on purpose", "as in the paper, and more": "as in the paper and more"}
        assert re.search(rf"\b{count}\s{words.get(status, status)}", text), status


def text_of(number: int) -> str:
    """Return the page's text about a statement."""
    return next(row[3] for row in rows() if number in numbers(row))


def suite() -> dict[int, Pack]:
    packs = {files.scene_id: read_pack(files) for files in parse_scenes(None, None)}
    return {scene: pack for scene, pack in packs.items() if scene <= 111}


def difficulty() -> dict[int, dict[str, int]]:
    """Map each scene of the suite to the figures of its difficulty certificate, each the maximum over 20 seeds."""
    stored = json.loads((ROOT / "scenes" / "certificates.json").read_text(encoding="utf-8"))["scenes"]
    return {
        scene["scene"]: check["figures"]
        for scene in stored
        for check in scene["checks"]
        if scene["scene"] <= 111 and check["name"] == "difficulty"
    }


def is_hard(pack: Pack) -> bool:
    return pack.category is not None and pack.category.value.startswith("hard")


def test_the_page_says_in_how_many_scenes_the_reference_fits_each_budget() -> None:
    needed = {scene: figures["iterations"] for scene, figures in difficulty().items()}
    fits = [sum(iterations <= budget for iterations in needed.values()) for budget in BUDGETS]
    assert BUDGETS == (5, 10, 15, 20)
    assert "{}, {}, {} and {} of the 105 scenes".format(*fits) in text_of(11)
    assert ("at 5 in none of the Hard ones" in text_of(11)) == all(
        needed[scene] > 5 for scene, pack in suite().items() if is_hard(pack)
    )


def test_easy_and_hard_references_intervene_as_often_as_the_page_says() -> None:
    figures = difficulty()
    for scene, pack in suite().items():
        if pack.category is not None and pack.category.value.startswith("easy"):
            assert figures[scene]["interventions"] <= 3
        if is_hard(pack):
            assert figures[scene]["interventions"] > 3
    assert f"All {sum(is_hard(pack) and pack.predicts for pack in suite().values())} Hard scenes" in text_of(36)


def test_each_category_has_the_scenes_of_the_page() -> None:
    packs = suite()
    spans = [range(int(first), int(last) + 1) for first, last in re.findall(r"(\d+)–(\d+)", text_of(20))]
    assert [scene for span in spans for scene in span] == list(range(7, 112))
    assert [{packs[scene].category for scene in span} for span in spans] == [
        {category} for category in Category if category is not Category.OPEN
    ]


def test_the_kinds_of_problems_are_as_many_as_the_page_says() -> None:
    kinds = Counter(problem_kind(pack.metadata.problem_type) for pack in suite().values())
    assert f"{kinds[QUALITATIVE]} comparison and observation scenes, {kinds[QUANTITATIVE]} of" in text_of(110)
    asked = [read_pack(files).answer_spec for files in parse_scenes(None, None)]
    assert ("No scene asks for one yet" in text_of(126)) == all(
        spec is None or spec.kind is not AnswerKind.FORMULA for spec in asked
    )


def test_all_topics_of_the_paper_occur_among_the_concepts() -> None:
    concepts = {concept for pack in suite().values() for concept in pack.concepts}
    for topic in ("kinematics", "Newton's second law", "rotation", "energy", "momentum", "oscillation", "friction"):
        assert topic in concepts
    for other in ("drag", "buoyancy", "magnetism", "gas law"):
        assert other in concepts


def test_the_published_dimensions_are_compared_with_the_measured_ones() -> None:
    """The values of G, V, R and G′ must be the rounded values of the table that is computed from the logs."""
    table = (DOCS / "explanation" / "failure-modes.md").read_text(encoding="utf-8")
    for number, name in ((96, "G"), (97, "V"), (98, "R"), (99, "G′")):
        found = re.search(rf"^\| mean {name} .*$", table, re.MULTILINE)
        assert found is not None
        # G′ is always defined; of the others the page gives the means over the episodes that define them.
        values = [f"{float(value):.2f}" for value in re.findall(r"(?:; |\| )(0\.\d{3})(?= \||\))", found[0])]
        assert len(values) == 3
        assert f"{', '.join(values)} against" in text_of(number), values
