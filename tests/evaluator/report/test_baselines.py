"""Tests of the baseline run in the package: its size, its use in reports, and how it is updated and replayed."""

import lzma
from collections import Counter
from pathlib import Path

import pytest

from evaluator.commands.program import main
from evaluator.records.run import RunRecord
from evaluator.report import baselines
from evaluator.report.agent_results import Run, agent_results, packs_of
from evaluator.report.baselines import EPISODES, FOLDER, RUN, SCORES, baseline_run, baseline_table
from evaluator.report.page import render
from evaluator.report.tables import Noted, Score, Share
from evaluator.scores.dimensions import WEIGHTS
from scenes import find_pack, same_pack
from tests.builders.commands import physment_eval

SUITE = range(7, 112)


def test_the_files_are_small_and_every_agent_played_the_suite() -> None:
    assert sum((FOLDER / name).stat().st_size for name in (EPISODES, SCORES, RUN)) < 1_500_000
    run = baseline_run()
    assert run is not None
    count = Counter(row.key.agent for row in run.scores)
    attackers = [f"attacker:{name}" for name in ("sweep", "glance", "proportional")]
    assert {name for name, n in count.items() if n == len(SUITE) * len(run.record.plan.seeds)} == {
        "blind",
        "random",
        *attackers,
    }
    designers = {"greedy-design", "random-design"}
    assert set(count) == {"blind", "random", "constant", "batch", *attackers, *designers}
    assert {count[name] for name in designers} == {44}, "they play the Easy scenes"


def test_they_were_played_on_the_packs_of_today() -> None:
    run = baseline_run()
    assert run is not None
    other = [scene for scene, pack in run.record.packs.items() if not same_pack(pack, find_pack(int(scene)))]
    assert other == [], f"CONTRIBUTING.md says how to play scenes {other} again"


def test_the_table_has_every_agent_and_each_score_follows_from_its_row() -> None:
    run = baseline_run()
    assert run is not None
    packs = run.record.content_hashes()
    table = baseline_table({**packs, "7": "other"})
    assert table is not None
    assert table.title.endswith("on 104 of 105 scenes")
    assert {row[0] for row in table.rows} == set(run.record.plan.agents)
    for row in table.rows:
        cells = dict(zip(table.columns, row, strict=True))
        assert isinstance(cells["strict"], Share)
        assert cells["strict"].n is not None
        assert cells["strict"].n <= 104
        printed = [cells[title] for title in ("C", "E", "G", "V", "R", "G′")]
        values = [cell.value or 0.0 for cell in printed if isinstance(cell, Noted)]
        total = sum(100 * weight * value for weight, value in zip(WEIGHTS.values(), values, strict=True))
        assert isinstance(cells["Final Score"], Score)
        assert cells["Final Score"].value == pytest.approx(total)


def test_a_report_shows_them_unless_they_are_left_out_or_the_packs_are_others(
    study: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "Baselines that ship" not in render([study]).page
    run, packs = baseline_run(), packs_of(agent_results([study]))
    assert run is not None
    assert baseline_table(packs) is None
    here = run._replace(record=run.record.model_copy(update={"packs": packs}))
    monkeypatch.setattr(baselines, "baseline_run", lambda: here)
    assert "Baselines that ship with the package, on 16 of 16 scenes" in render([study]).page
    assert "Baselines that ship" not in render([study], baselines=False).page


def folder_of_two_scenes(path: Path) -> Path:
    """A run folder with the baselines' episodes of two scenes, as the package stores them."""
    run = baseline_run()
    assert run is not None
    plan = run.record.plan.model_copy(update={"scenes": (7, 9)})
    path.mkdir()
    (path / RUN).write_text(run.record.model_copy(update={"plan": plan}).model_dump_json(), encoding="utf-8")
    lines = lzma.decompress((FOLDER / EPISODES).read_bytes()).splitlines(keepends=True)
    chosen = [line for line in lines if line[:60].split(b'"scene":')[1].split(b",")[0] in {b"7", b"9"}]
    (path / "episodes.jsonl").write_bytes(b"".join(chosen))
    return path


def test_the_kept_episodes_are_a_run_that_replays(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run = folder_of_two_scenes(tmp_path / "run")
    assert main(["replay", str(run)]) == 0
    assert ": 16 episodes the same, 0 differences" in capsys.readouterr().out


def test_a_run_of_some_scenes_replaces_their_records_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run, kept = folder_of_two_scenes(tmp_path / "run"), tmp_path / "kept"
    for _ in range(2):
        assert main(["keep-baselines", str(run), "--out", str(kept)]) == 0
        assert capsys.readouterr().out.startswith("16 episodes, ")
    found = baseline_run(kept)
    assert found is not None
    whole = baseline_run()
    assert whole is not None
    assert found.scores == [row for row in whole.scores if row.key.scene in {7, 9}]
    (run / RUN).write_text((run / RUN).read_text(encoding="utf-8").replace('"budgets":[20]', '"budgets":[5]'), "utf-8")
    done = physment_eval("keep-baselines", run, "--out", kept)
    assert (done.returncode, "the kept baselines have the budgets (20,), this run has (5,)" in done.stderr) == (2, True)


@pytest.mark.parametrize(("pack", "left"), [("same", 17), ("changed", 9)])
def test_another_agent_adds_records_and_removes_those_of_other_packs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], pack: str, left: int
) -> None:
    run, kept = folder_of_two_scenes(tmp_path / "run"), tmp_path / "kept"
    assert main(["keep-baselines", str(run), "--out", str(kept)]) == 0
    lines = [line for line in (run / "episodes.jsonl").read_text("utf-8").splitlines() if '"agent":"blind"' in line]
    added = [line.replace('"agent":"blind"', '"agent":"newcomer"') for line in lines if '"scene":7,' in line]
    (run / "episodes.jsonl").write_text("".join(f"{line}\n" for line in added), "utf-8")
    record = RunRecord.model_validate_json((run / RUN).read_bytes())
    packs = {"7": record.packs["7"] if pack == "same" else "c1:000000000000"}
    plan = record.plan.model_copy(update={"scenes": (7,), "agents": ("newcomer",)})
    (run / RUN).write_text(record.model_copy(update={"plan": plan, "packs": packs}).model_dump_json(), "utf-8")
    assert main(["keep-baselines", str(run), "--out", str(kept)]) == 0
    noted = "are left out: their packs changed" in capsys.readouterr().out
    assert noted is (pack == "changed")
    found = baseline_run(kept)
    assert found is not None
    assert found.record.plan.agents == (*record.plan.agents, "newcomer")
    assert [row.key.scene for row in found.scores if row.key.agent == "newcomer"] == [7]
    assert len(found.scores) == left
