"""Tests of the files that `physment-eval report` writes, for one or several runs, as one file or with notebooks."""

import csv
import json
import re
import shutil
from collections.abc import Sequence
from pathlib import Path

import pytest

from evaluator.answers.keys import KeyRing
from evaluator.commands.program import main
from evaluator.records.run import Plan, ServerRecord
from evaluator.report.agent_results import Run
from evaluator.report.notebook import pictures
from evaluator.report.page import PAGES, render, write_report
from evaluator.scores.scoring import grade_run
from evaluator.store.run_folder import RunFolder
from evaluator.study.run_start import run_record
from scenes import default_folder, find_pack, pack_hash
from tests.builders.reports import PNG, played, run_of

EVIL = "</script><script>alert(1)</script><img src=x onerror=alert(1)>\u2028 {{ 7*7 }}"


def store(folder: Path, agent: str, scenes: Sequence[int] = (7, 8), scenes_dir: Path | None = None) -> Path:
    """The folder of a graded run, made of recorded episodes."""
    run = RunFolder(folder)
    run.create(resume=False)
    packs = [find_pack(scene, scenes_dir) for scene in scenes]
    plan = Plan(scenes=tuple(scenes), agents=(agent,), budgets=(5,))
    run.write_run(run_record(plan, packs, ServerRecord(option="host")))
    for scene in scenes:
        run.append_episode(played(scene, agent, 5, right=True).episode)
    grade_run(run, KeyRing(scenes_dir))
    return folder


def test_many_notebooks_are_written_beside_the_page_and_hold_no_script_of_an_agent(tmp_path: Path) -> None:
    run = run_of([played(scene, f"a {EVIL}", 5, right=True) for scene in range(7, 10)])
    page = write_report(RunFolder(tmp_path), [run], inline=2).read_text(encoding="utf-8")
    scripts = sorted(file.name for file in (tmp_path / PAGES).iterdir())
    assert scripts == ["1.js", "2.js", "3.js"]
    assert "Where is the ball?" not in page
    assert "'strict-dynamic'" in page
    for name in scripts:
        script = (tmp_path / PAGES / name).read_text(encoding="utf-8")
        call = re.fullmatch(r"physmentNotebook\((\d+), (.*)\);\n", script)
        assert call is not None
        assert f"{call[1]}.js" == name
        html = json.loads(call[2])
        assert "Where is the ball?" in html
        assert "<script" not in html
        assert "{{ 7*7 }}" in html
        assert set(re.findall(r"<img [^>]*src=\"([^\",]*)", html)) <= {"data:image/png;base64"}


def test_a_smaller_report_removes_the_notebooks_of_a_larger_one_and_nothing_else(tmp_path: Path) -> None:
    run = run_of([played(scene, "a", 5, right=True) for scene in range(7, 10)])
    write_report(RunFolder(tmp_path), [run], inline=2)
    (tmp_path / PAGES / "notes.txt").write_text("mine")
    page = write_report(RunFolder(tmp_path), [run]).read_text(encoding="utf-8")
    assert [one.name for one in (tmp_path / PAGES).iterdir()] == ["notes.txt"]
    assert "Where is the ball?" in page
    assert "strict-dynamic" not in page


def test_a_scene_has_its_picture_and_evidence_links_to_its_place(study: Run) -> None:
    page = render([study]).page
    assert page.count('<img src="data:image/png;base64,') == sum(row.episode.key.scene == 7 for row in study.rows)
    anchors = set(re.findall(r'id="([^"]+)"', page))
    leads = re.findall(r'href="#(episode-[^"]+)">iteration 2, call 2</a>: <q>no idea</q>; simulated s 0.2', page)
    assert len(leads) == 16
    assert set(leads) <= anchors


def test_only_pictures_of_the_packs_that_were_played_are_used(tmp_path: Path) -> None:
    packs, kept = tmp_path / "scenes", tmp_path / "docs" / "reference" / "scenes" / "small"
    kept.mkdir(parents=True)
    for scene in (7, 8):
        (packs / f"Scene{scene}").mkdir(parents=True)
        for file in (default_folder() / f"Scene{scene}").glob("*.*"):
            (packs / f"Scene{scene}" / file.name).write_bytes(file.read_bytes())
        (kept / f"scene{scene}.png").write_bytes(PNG)
    assert pictures({"7": pack_hash(find_pack(7, packs)), "8": "another"}, packs) == {7: PNG}
    assert pictures({}, packs) == {}


def test_runs_of_different_scenes_give_no_warning_about_different_packs(tmp_path: Path) -> None:
    runs = [store(tmp_path / str(len(scenes)), "x", scenes) for scenes in ([7], [7, 12])]
    assert main(["report", *map(str, runs), "--out", str(tmp_path / "out")]) == 0
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "Not all of these were played on the same packs" not in page


def test_a_report_can_hold_several_runs_each_with_its_own_packs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    packs = tmp_path / "packs"
    (packs / "Scene7").mkdir(parents=True)
    for file in (default_folder() / "Scene7").glob("*.*"):
        text = file.read_text(encoding="utf-8").replace('"easy-single"', '"hard-multi"')
        (packs / "Scene7" / file.name).write_text(text, encoding="utf-8")
    ours = store(tmp_path / "ours", "model:ours")
    theirs = store(tmp_path / "theirs", "model:theirs", [7], packs)
    words = ["report", str(ours), str(theirs), "--scenes-dir", str(packs), "--out", str(tmp_path / "out"), "--export"]
    assert main([*words, "csv"]) == 0
    assert capsys.readouterr().out.splitlines()[0] == str(tmp_path / "out" / "report.html")
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "Not all of these were played on the same packs" in page
    rows = (tmp_path / "out" / "tables-by_category.csv").read_text(encoding="utf-8").splitlines()
    assert {row.split(",")[0] for row in rows[1:]} >= {"hard-multi"}
    for form, name in (("md", "tables.md"), ("latex", "tables.tex")):
        assert main([*words, form]) == 0
        assert (tmp_path / "out" / name).stat().st_size > 500


def test_a_run_of_open_worlds_is_graded_by_prediction_and_told_how_much_of_the_limits_was_used(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    packs = tmp_path / "packs"
    shutil.copytree(default_folder() / "Scene104", packs / "Scene201")
    for file in (packs / "Scene201").glob("scene104.*"):
        file.rename(file.with_name(file.name.replace("104", "201")))
    file = packs / "Scene201" / "scene201.json"
    pack = json.loads(file.read_text(encoding="utf-8"))
    right, _ = pack["answer"]
    file.write_text(json.dumps(pack | {"category": "open", "limits": {"calls": 8, "lab_time": 2.0}}), encoding="utf-8")
    run = RunFolder(store(tmp_path / "run", "x", [201], packs))
    (episode,) = run.episodes().values()
    run.episodes_file.write_text(episode.model_copy(update={"answer": [right, 0]}).model_dump_json() + "\n")
    assert main(["grade", str(run.path), "--scenes-dir", str(packs)]) == 0
    said = capsys.readouterr().out
    assert "open worlds: all predictions right 0.0 % (0/1), predictions right 50.0 %" in said
    assert "strict accuracy" not in said
    assert main(["report", str(run.path), "--scenes-dir", str(packs), "--export", "csv"]) == 0
    head, row = csv.reader((run.path / "tables-experiment_cost.csv").read_text(encoding="utf-8").splitlines())
    told = dict(zip(head, row, strict=True))
    assert {name: told[name] for name in ("rung", "calls", "lab time [s]", "of call limit", "of lab time limit")} == {
        "rung": "open",
        "calls": "4",
        "lab time [s]": "0.2",
        "of call limit": "0.5",
        "of lab time limit": "0.1",
    }


def test_a_report_of_several_runs_needs_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folders = [str(store(tmp_path / name, name)) for name in ("a", "b")]
    assert main(["report", *folders]) == 2
    assert "--out DIR" in capsys.readouterr().err


def test_for_an_ungraded_run_the_error_names_the_grade_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = store(tmp_path / "a", "a")
    RunFolder(folder).grades_file.write_text("")
    assert main(["report", str(folder)]) == 2
    assert f"physment-eval grade {folder}" in capsys.readouterr().err
