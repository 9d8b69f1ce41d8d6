"""Tests that summaries, reports and comparisons show predictions and laws as two columns."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import pytest

from evaluator.answers.keys import KeyRing
from evaluator.records.episode import Episode, EpisodeKey, LawGrade, Verdict
from evaluator.report.agent_results import agent_results
from evaluator.report.agent_tables import laws_table
from evaluator.report.page import render
from evaluator.report.tables import Count
from evaluator.scores.comparison import Side, compare
from evaluator.scores.metrics import summarise
from evaluator.scores.scored_episode import ScoredEpisode, StatedEpisode, law_sentence, law_summary
from evaluator.scores.scoring import grade_run, law_grade
from evaluator.store.run_folder import RunFolder
from tests.builders.records import episode, episode_key, grade, returned, turn
from tests.builders.reports import run_of
from tests.builders.scored import scored

KNOWN = LawGrade(
    version="1", sha256="0", equivalent=True, error_within=0.001, error_beyond=0.01, dependence_f1=1, length=50
)
OTHER = LawGrade(version="1", sha256="1", equivalent=False, error_within=0.3, dependence_f1=0.5, length=9)
LAW = {"acceleration": {"object_1": {"x": "object_1_push_x - object_1_vx", "y": "object_1_push_y"}}}


def row(scene: int, right: bool, law: LawGrade | None, agent: str = "x") -> ScoredEpisode:
    made = scored(episode(key=episode_key(scene, agent=agent)), grade(right), "open")
    return replace(made, record=made.record.model_copy(update={"law": law}), asks_for_law=True)


ROWS = [
    row(201, True, KNOWN),
    row(202, True, OTHER),
    row(203, True, None),
    row(204, False, KNOWN),
    row(205, False, OTHER),
]


def test_a_summary_counts_who_predicted_and_who_knew() -> None:
    found = summarise(ROWS).by_rung["open"].laws
    assert found is not None
    assert (found.asked, found.stated, found.known, found.predicted) == (5, 4, 2, 3)
    assert (found.predicted_and_known, found.predicted_not_known, found.predicted_not_stated) == (1, 1, 1)
    assert (found.dependence_f1, found.length) == (0.75, 50)
    assert "of 3 that predicted, 1 knew the law, 1 stated another law and 1 stated none" in law_sentence(found)


def test_scenes_that_ask_for_no_law_have_no_summary_of_laws() -> None:
    suite = scored(episode(key=episode_key(7)), grade(True))
    assert law_summary([]) is None
    summary = summarise([suite])
    assert summary.overall.laws is None
    assert '"laws"' not in summary.model_dump_json()
    assert suite.stated is None
    assert ROWS[2].stated == StatedEpisode(None, Verdict.CORRECT)


def test_a_report_says_how_many_predicted_but_did_not_know() -> None:
    run = run_of(ROWS)
    table = laws_table(agent_results([run]))
    assert table is not None
    cells = dict(zip(table.columns, table.rows[0], strict=True))
    assert cells["predicted"] == Count(3, 5)
    assert cells["knew the law"] == Count(2, 5)
    assert cells["predicted but did not know"] == Count(1, 3)
    page = render([run]).page
    assert "Do agents that predict also know?" in page
    assert "error 0.1 % within its reach, 1.0 % beyond" in page
    assert "error 30.0 % within its reach, none finite beyond" in page
    silent = run_of([row(201, True, None)])
    assert laws_table(agent_results([silent])) is None
    assert "also know?" not in render([silent]).page


def test_a_comparison_shows_the_laws_of_both_sides() -> None:
    other = [row(scene, True, KNOWN, agent="y") for scene in range(201, 206)]
    found = compare(Side("a", ROWS), Side("b", other))
    assert found.laws_a is not None
    assert found.laws_b is not None
    assert (found.laws_a.known, found.laws_b.known) == (2, 5)


@pytest.fixture
def folder(tmp_path: Path) -> RunFolder:
    """A run with one episode of scene 201, in which the agent gave a law with its answer."""
    run = RunFolder(tmp_path / "run")
    (tmp_path / "run").mkdir()
    key = episode_key(201, seed=1)
    run.append_episode(episode(turn("", returned("answer", {}, answer=[1, 2, 3], law=LAW)), key=key, answer=[1, 2, 3]))
    return run


def test_grading_stores_the_grade_of_a_law_and_keeps_that_of_an_unchanged_one(folder: RunFolder) -> None:
    first = grade_run(folder, KeyRing()).rows[0]
    assert first.record.law is not None
    assert not first.record.law.equivalent
    (line,) = folder.path.joinpath("grades.jsonl").read_text(encoding="utf-8").splitlines()
    assert json.loads(line)["law"]["length"] == first.record.law.length
    kept = first.record.model_copy(update={"law": first.record.law.model_copy(update={"dependence_f1": 0.123})})
    stored = first.episode
    assert law_grade(stored, KeyRing(), kept) == kept.law
    for change in ({"version": "0"}, {"sha256": "0"}):
        assert kept.law is not None
        other = kept.model_copy(update={"law": kept.law.model_copy(update=change)})
        assert law_grade(stored, KeyRing(), other) == first.record.law


def test_a_verdict_on_a_law_that_changes_is_listed_and_the_grades_before_are_kept(folder: RunFolder) -> None:
    record = grade_run(folder, KeyRing()).rows[0].record
    assert record.law is not None
    law = record.law.model_copy(update={"equivalent": True, "version": "0"})
    folder.write_grades([record.model_copy(update={"law": law})])
    line, kept = grade_run(folder, KeyRing()).changes
    assert line == f"scene 201 seed 1 x: law equivalent → not equivalent (law grader 0 → {record.law.version})"
    assert "the previous grades are kept in" in kept
    assert grade_run(folder, KeyRing()).changes == []


def test_grading_a_run_again_does_not_trust_the_grade_of_a_law_that_it_finds(folder: RunFolder) -> None:
    record = grade_run(folder, KeyRing()).rows[0].record
    assert record.law is not None
    forged = record.model_copy(update={"law": record.law.model_copy(update={"equivalent": True})})
    folder.write_grades([forged])
    assert grade_run(folder, KeyRing(), keep_laws=True).rows[0].record == forged
    again = grade_run(folder, KeyRing())
    assert again.rows[0].record == record
    line = "scene 201 seed 1 x: law equivalent → not equivalent (the stored grade is not that of this grader)"
    assert again.changes[0] == line


def test_the_episodes_of_a_run_are_graded_as_the_caller_tracks_them(folder: RunFolder) -> None:
    seen: list[Episode] = []

    def tracked(episodes: Sequence[Episode]) -> Iterator[Episode]:
        for one in episodes:
            seen.append(one)
            yield one

    rows = grade_run(folder, KeyRing(), tracked=tracked).rows
    assert seen == [row.episode for row in rows] == list(folder.episodes().values())


def test_an_episode_without_a_law_or_of_another_scene_has_no_grade_of_a_law() -> None:
    plain = episode(turn("", returned("answer", {}, answer=1)), key=episode_key(201))
    assert law_grade(plain, KeyRing()) is None
    suite = episode(
        turn("", returned("answer", {}, answer=1, law=LAW)), key=EpisodeKey(scene=7, seed=0, agent="x", budget=1)
    )
    assert law_grade(suite, KeyRing()) is None
