"""Tests of `physment-eval evidence`: it measures a stored run, resumes, and reports errors."""

import json
from pathlib import Path

import pytest

from evaluator.records.evidence import EvidenceVerdict, evidence_verdict
from evaluator.store.run_folder import RunFolder
from tests.builders.commands import physment_eval

AGENTS = ("--agent", "reference", "--agent", "blind")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run with two agents in two scenes."""
    folder = tmp_path_factory.mktemp("run") / "played"
    done = physment_eval("run", "--server", "host", *AGENTS, "--scenes", "7,13", "--out", folder)
    assert done.returncode == 0
    return folder


def test_each_episode_gets_its_evidence_once(run: Path) -> None:
    first = physment_eval("evidence", run, "--workers", "1", "--episodes", "scene=7")
    assert first.returncode == 0
    folder = RunFolder(run)
    lines = folder.evidence_file.read_text(encoding="utf-8")
    assert {key.scene for key in folder.evidence()} == {7}
    assert physment_eval("evidence", run, "--workers", "1").returncode == 0
    assert folder.evidence_file.read_text(encoding="utf-8").startswith(lines)
    evidence, grades = folder.evidence(), folder.grades()
    assert len(evidence) == 4
    found = {(key.agent, key.scene): evidence_verdict(one, grades[key].grade.strict) for key, one in evidence.items()}
    assert found["reference", 7] is found["reference", 13] is EvidenceVerdict.EARNED
    assert found["blind", 7] in {EvidenceVerdict.EXPERIMENT_INSUFFICIENT, EvidenceVerdict.GUESSED}


def test_episodes_that_differ_only_in_their_answers_are_measured_once(tmp_path: Path) -> None:
    run = tmp_path / "run"
    words = ("--agent", "taker:none", "--agent", "taker:wrong-law", "--agent", "blind")
    assert physment_eval("run", "--server", "host", *words, "--scenes", "13", "--out", run).returncode == 0
    assert physment_eval("evidence", run, "--workers", "2").returncode == 0
    folder = RunFolder(run)
    found = {key.agent: one for key, one in folder.evidence().items()}
    hashes = folder.line_hashes()
    assert all(one.episode == hashes[key] for key, one in folder.evidence().items())
    right, wrong, blind = found["taker:none"], found["taker:wrong-law"], found["blind"]
    assert right.calls == wrong.calls != blind.calls
    assert min(right.seconds, wrong.seconds) == 0.0
    assert max(right.seconds, wrong.seconds) > 0.0 < blind.seconds


def test_the_evidence_in_a_world_excludes_other_laws_if_there_are_enough_readings(tmp_path: Path) -> None:
    run = tmp_path / "run"
    words = ("--agent", "reference", "--agent", "taker:calls-12", "--scenes", "world:2:0")
    assert physment_eval("run", "--server", "host", *words, "--out", run).returncode == 0
    assert physment_eval("evidence", run, "--workers", "2").returncode == 0
    folder = RunFolder(run)
    evidence, grades = folder.evidence(), folder.grades()
    found = {key.agent: evidence_verdict(one, grades[key].grade.strict) for key, one in evidence.items()}
    assert found["reference"] is EvidenceVerdict.EARNED
    assert found["taker:calls-12"] in {EvidenceVerdict.EXPERIMENT_INSUFFICIENT, EvidenceVerdict.GUESSED}
    assert all("glider: " in rival.name for one in evidence.values() for rival in one.rivals)
    assert any(not rival.excluded for one in evidence.values() for rival in one.rivals)


def test_the_evidence_can_be_read_as_json_lines(run: Path) -> None:
    done = physment_eval("evidence", run, "--workers", "1", "--json", "--episodes", "scene=7,agent=reference")
    (line,) = done.stdout.splitlines()
    read = json.loads(line)
    assert read["key"]["scene"] == 7
    assert read["calls"][-1]["bounds"][0] < 0.5


def test_evidence_of_a_changed_episode_is_measured_again(run: Path) -> None:
    physment_eval("evidence", run, "--workers", "1")
    folder = RunFolder(run)
    kept = folder.evidence_file.read_text(encoding="utf-8")
    stale = kept.replace('"episode":"', '"episode":"0')
    folder.evidence_file.write_text(stale, encoding="utf-8")
    physment_eval("evidence", run, "--workers", "1", "--episodes", "scene=7,agent=blind")
    assert len(folder.evidence_file.read_text(encoding="utf-8").splitlines()) == len(kept.splitlines()) + 1


def test_a_folder_without_episodes_is_refused(tmp_path: Path) -> None:
    done = physment_eval("evidence", tmp_path)
    assert done.returncode == 2
    assert "holds no episodes to measure" in done.stderr


def test_the_report_shows_the_evidence_of_present_episodes_alone(run: Path, tmp_path: Path) -> None:
    physment_eval("evidence", run, "--workers", "1")
    assert physment_eval("report", run, "--out", tmp_path / "with").returncode == 0
    page = (tmp_path / "with" / "report.html").read_text(encoding="utf-8")
    assert "Were the experiments at fault, or the reasoning?" in page
    assert "earned; it sufficed after call" in page
    folder = RunFolder(run)
    kept = folder.evidence_file.read_text(encoding="utf-8")
    folder.evidence_file.write_text(kept.replace('"episode":"', '"episode":"0'), encoding="utf-8")
    assert physment_eval("report", run, "--out", tmp_path / "without").returncode == 0
    assert "Were the experiments" not in (tmp_path / "without" / "report.html").read_text(encoding="utf-8")
    folder.evidence_file.write_text(kept, encoding="utf-8")


def test_the_comparison_and_the_summary_count_the_verdicts_of_measured_episodes(run: Path) -> None:
    sides = ("compare", run, run, "--a", "agent=blind", "--b", "agent=reference")
    physment_eval("evidence", run, "--workers", "1")
    done = physment_eval(*sides, "--json")
    found = json.loads(done.stdout)
    assert found["evidence_b"]["verdicts"]["earned"] == 2
    assert found["evidence_a"]["verdicts"]["earned"] == 0
    assert "not measurable" in physment_eval(*sides).stdout
    assert physment_eval("grade", run).returncode == 0
    summary = json.loads(RunFolder(run).summary_file.read_text(encoding="utf-8"))
    assert summary["by_agent"]["reference"]["evidence"]["verdicts"]["earned"] == 2
    kept = RunFolder(run).evidence_file.read_text(encoding="utf-8")
    RunFolder(run).evidence_file.unlink()
    assert "evidence_a" not in json.loads(physment_eval(*sides, "--json").stdout)
    assert "not measurable" not in physment_eval(*sides).stdout
    RunFolder(run).evidence_file.write_text(kept, encoding="utf-8")


def test_while_seeds_are_held_back_no_rival_is_named(tmp_path: Path) -> None:
    key = tmp_path / "seeds.key"
    key.write_text("5a" * 32 + "\n", encoding="utf-8")
    key.chmod(0o600)
    run = tmp_path / "run"
    words = ("run", "--server", "host", "--agent", "reference", "--scenes", "13")
    assert physment_eval(*words, "--seed-key", key, "--out", run).returncode == 0
    chosen = ("--episodes", "agent=reference", "--workers", "1")
    assert physment_eval("evidence", run, "--seed-key", key, *chosen).returncode == 0
    rivals = [rival for found in RunFolder(run).evidence().values() for rival in found.rivals]
    assert rivals
    assert all(rival.name.startswith("rival ") for rival in rivals)
    assert "order" not in RunFolder(run).evidence_file.read_text(encoding="utf-8")


def test_text_of_a_stored_record_cannot_reach_the_terminal(run: Path) -> None:
    physment_eval("evidence", run, "--workers", "1")
    folder = RunFolder(run)
    kept = folder.evidence_file.read_text(encoding="utf-8")
    evil = kept.replace('"not_measurable":""', r'"not_measurable":"\u001b[31m[/x]"')
    folder.evidence_file.write_text(evil, encoding="utf-8")
    done = physment_eval("evidence", run, "--workers", "1")
    folder.evidence_file.write_text(kept, encoding="utf-8")
    assert done.returncode == 0
    assert "\x1b[31m" not in done.stdout
    assert r"\x1b[31m[/x]" in done.stdout
