"""Tests of known faults: they withdraw verdicts or are reported; a run on other packs keeps its grades."""

import json
import shutil
from pathlib import Path

import pytest

from evaluator.commands.program import main
from evaluator.records.episode import Verdict
from evaluator.scores.metrics import RunSummary
from evaluator.store.run_folder import RunFolder
from scenes import default_folder, find_pack, pack_hash

FAULT = "The key is that of another body."


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory, host_url: str) -> Path:
    """A graded run with right answers in scenes 7 and 8."""
    folder = tmp_path_factory.mktemp("played") / "run"
    assert main(["run", "--agent", "reference", "--scenes", "7,8", "--server", host_url, "--out", str(folder)]) == 0
    return folder


@pytest.fixture
def run(played: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(played, tmp_path / "run"))


@pytest.fixture
def packs(tmp_path: Path) -> Path:
    """A folder with copies of the packs of the run."""
    for scene in (7, 8):
        shutil.copytree(default_folder() / f"Scene{scene}", tmp_path / "packs" / f"Scene{scene}")
    return tmp_path / "packs"


def publish(packs: Path, effect: str, scene: int = 7) -> None:
    """Add a known fault to the errata of a folder; it refers to the suite's version of the pack of a scene."""
    entry = {
        "scene": scene,
        "pack": pack_hash(find_pack(scene)),
        "effect": effect,
        "fault": FAULT,
        "date": "2026-11-26",
    }
    (packs / "errata.json").write_text(json.dumps([entry]), encoding="utf-8")


def change(packs: Path, scene: int = 7) -> None:
    """Make another version of a pack, with another key."""
    files = find_pack(scene, packs)
    pack = json.loads(files.json.read_text(encoding="utf-8"))
    files.json.write_text(json.dumps(pack | {"answer": 123.0}), encoding="utf-8")


def verdicts(run: Path) -> dict[int, Verdict]:
    return {key.scene: record.grade.strict for key, record in RunFolder(run).grades().items()}


def summary_of(run: Path) -> RunSummary:
    return RunSummary.model_validate_json((run / "summary.json").read_bytes())


def grade(run: Path, packs: Path, *words: str) -> int:
    return main(["grade", str(run), "--scenes-dir", str(packs), *words])


def test_an_episode_on_a_withdrawn_pack_has_no_verdict_and_bounds_the_accuracy(
    run: Path, packs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    publish(packs, "withdrawn")
    assert grade(run, packs) == 0
    said = capsys.readouterr().out
    assert verdicts(run) == {7: Verdict.UNSCORED, 8: Verdict.CORRECT}
    whole = summary_of(run).overall
    assert (whole.n, whole.n_scored, whole.n_withdrawn, whole.n_correct) == (2, 1, 1, 1)
    assert whole.accuracy_bounds is not None
    assert (whole.accuracy_bounds.all_wrong, whole.accuracy_bounds.all_right) == (0.5, 1.0)
    assert "(1/1; 1 withdrawn: 50.0 % if all of these were wrong, 100.0 % if all were right)" in said
    assert f"1 episode: {FAULT}" in said
    assert f"correct → unscored, normalised correct → unscored (withdrawn: {FAULT})" in said
    page = (run / "report.html").read_text(encoding="utf-8")
    assert FAULT in page
    assert "50.0 % if all of these were wrong" in page


def test_a_noted_fault_is_stated_and_changes_no_verdict(
    run: Path, packs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    publish(packs, "noted")
    assert grade(run, packs) == 0
    assert verdicts(run) == {7: Verdict.CORRECT, 8: Verdict.CORRECT}
    assert summary_of(run).overall.accuracy_bounds is None
    assert [(found.erratum.scene, found.n) for found in summary_of(run).errata] == [(7, 1)]
    assert f"noted: scene 7 as pack {pack_hash(find_pack(7))}, 1 episode: {FAULT}" in capsys.readouterr().out


def test_a_report_applies_errata_that_were_published_after_the_grades(run: Path, packs: Path) -> None:
    publish(packs, "withdrawn")
    assert main(["report", str(run), "--scenes-dir", str(packs), "--export", "md"]) == 0
    tables = (run / "tables.md").read_text(encoding="utf-8")
    assert "1 withdrawn: 50.0 % if all of these were wrong, 100.0 % if all were right" in tables
    assert verdicts(run)[7] is Verdict.CORRECT, "a report writes no grades"


def test_a_withdrawn_pack_needs_no_key_once_another_version_is_here(run: Path, packs: Path) -> None:
    publish(packs, "withdrawn")
    change(packs)
    (run / "grades.jsonl").unlink()
    assert grade(run, packs) == 0
    assert verdicts(run) == {7: Verdict.UNSCORED, 8: Verdict.CORRECT}


def test_a_scene_on_another_pack_keeps_its_grade(run: Path, packs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    change(packs)
    assert grade(run, packs) == 0
    assert verdicts(run) == {7: Verdict.CORRECT, 8: Verdict.CORRECT}
    assert "so the stored grades are kept: scene 7" in capsys.readouterr().err


def test_a_scene_on_another_pack_without_a_grade_is_refused_or_graded_on_request(
    run: Path, packs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    change(packs)
    (run / "grades.jsonl").unlink()
    assert grade(run, packs) == 2
    assert "scene 7 was played on another pack than the one here" in capsys.readouterr().err
    assert grade(run, packs, "--allow-other-packs") == 0
    assert verdicts(run) == {7: Verdict.INCORRECT, 8: Verdict.CORRECT}


def test_a_submission_holds_after_an_erratum_which_the_check_names(
    run: Path, packs: Path, host_url: str, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = ["--scenes-dir", str(packs)]
    check = ["check-submission", str(run / "submission.json"), str(run), *folder, "--server", host_url]
    assert main(["submit", str(run), *folder]) == 0
    publish(packs, "withdrawn")
    for regrade in (False, True):
        if regrade:
            assert grade(run, packs) == 0
        capsys.readouterr()
        assert main(check) == 0
        assert f"scene 7 was withdrawn after the submission: {FAULT}" in capsys.readouterr().out
    assert main(["submit", str(run), *folder]) == 0
    submission = json.loads((run / "submission.json").read_text(encoding="utf-8"))
    assert submission["withdrawn"] == [pack_hash(find_pack(7))]
    capsys.readouterr()
    assert main(check) == 0
    assert "after the submission" not in capsys.readouterr().out
    (packs / "errata.json").unlink()
    assert main(check) == 2, "nobody may withdraw episodes by a fault that is not published"


def test_malformed_errata_are_refused_by_grade_and_lint(
    run: Path, packs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (packs / "errata.json").write_text('[{"scene": 7}]', encoding="utf-8")
    assert grade(run, packs) == 2
    assert "errata.json: entry 0.pack: Field required" in capsys.readouterr().err
    assert main(["lint", "--scenes-dir", str(packs)]) == 1
    assert "errata.json: entry 0.pack: Field required" in capsys.readouterr().out
