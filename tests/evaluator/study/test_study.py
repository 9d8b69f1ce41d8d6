"""Tests of large runs: shards, limits, study files and merged runs."""

import json
import re
from collections import Counter
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from evaluator.commands.program import main, with_config, with_new_names
from evaluator.commands.run import CHARACTERS_PER_TOKEN, PROMPT_TOKENS, TURN_TOKENS, input_tokens
from evaluator.errors import UsageError
from evaluator.records.episode import Usage
from evaluator.records.run import Plan
from evaluator.store.run_folder import RunFolder
from evaluator.study.meter import Limits, Meter
from evaluator.study.shards import WHOLE, Shard, parse_shard, shard_of_environment
from physment_mcp.scene import load_scene
from physment_mcp.serving.prompts import PromptOptions, opening_prompt
from physment_mcp.serving.server import published_tools
from physment_mcp.session import Session
from scenes import list_packs

PLAN = Plan(scenes=tuple(range(7, 112)), agents=("a", "b"), budgets=(5, 10), seeds=(0, 1), promptings=("x", "y"))
OPTIONS = {"--agent", "--budgets", "--max-cost", "--resume", "--scenes"}


@given(count=st.integers(1, 40))
def test_shards_take_every_episode_once(count: int) -> None:
    keys = PLAN.matrix()
    taken = Counter(key for index in range(1, count + 1) for key in keys if Shard(index, count).takes(key))
    assert taken == Counter(keys)


def test_shards_are_the_same_on_every_machine_and_of_similar_size() -> None:
    sizes = [sum(Shard(index, 8).takes(key) for key in PLAN.matrix()) for index in range(1, 9)]
    # These must not change: machines with different versions would play some episodes twice and others never.
    assert sizes[:3] == [210, 199, 217]
    assert min(sizes) > 0.75 * max(sizes)


@pytest.mark.parametrize(
    ("environ", "shard"),
    [
        ({}, WHOLE),
        ({"SLURM_ARRAY_TASK_ID": "3", "SLURM_ARRAY_TASK_MIN": "1", "SLURM_ARRAY_TASK_COUNT": "8"}, Shard(3, 8)),
        ({"SLURM_ARRAY_TASK_ID": "0", "SLURM_ARRAY_TASK_MIN": "0", "SLURM_ARRAY_TASK_COUNT": "8"}, Shard(1, 8)),
        (
            {
                "SLURM_ARRAY_TASK_ID": "20",
                "SLURM_ARRAY_TASK_MIN": "10",
                "SLURM_ARRAY_TASK_STEP": "5",
                "SLURM_ARRAY_TASK_COUNT": "4",
            },
            Shard(3, 4),
        ),
        ({"JOB_COMPLETION_INDEX": "0", "PHYSMENT_SHARDS": "5"}, Shard(1, 5)),
    ],
)
def test_the_shard_is_read_from_the_variables_of_a_scheduler(environ: dict[str, str], shard: Shard) -> None:
    assert shard_of_environment(environ) == shard


@pytest.mark.parametrize(
    "environ",
    [
        {"JOB_COMPLETION_INDEX": "2"},
        {"JOB_COMPLETION_INDEX": "5", "PHYSMENT_SHARDS": "5"},
        {"JOB_COMPLETION_INDEX": "x", "PHYSMENT_SHARDS": "5"},
        {"SLURM_ARRAY_TASK_ID": "3"},
    ],
)
def test_incomplete_or_contradictory_variables_of_a_scheduler_are_refused(environ: dict[str, str]) -> None:
    with pytest.raises(UsageError, match="--shard i/n"):
        shard_of_environment(environ)


@pytest.mark.parametrize("text", ["", "3", "0/4", "5/4", "a/b", "1/", "-1/2"])
def test_a_malformed_shard_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="write i/n"):
        parse_shard(text)


def test_each_limit_is_reported_when_it_is_reached() -> None:
    now = [0.0]
    meter = Meter(Limits(cost_usd=1.0, tokens=1000, wall_s=60), lambda: now[0])
    meter.add_all([None, Usage(input_tokens=100, output_tokens=50, cached_tokens=90, cost_usd=0.4)])
    assert meter.reached() == ""
    meter.add(Usage(input_tokens=10, cost_usd=0.6))
    assert meter.reached() == "--max-cost is reached: $1.00 of $1.00"
    meter.cost_usd = 0.0
    meter.add(Usage(output_tokens=840, cost_usd=0.0))
    assert meter.reached() == "--max-tokens is reached: 1000 of 1000"
    meter.tokens, now[0] = 0, 60.0
    assert meter.reached() == "--max-time is reached: 60 s of 60 s"


def test_an_unknown_cost_is_never_taken_for_zero() -> None:
    meter = Meter(Limits(cost_usd=1.0))
    meter.add(Usage(input_tokens=10))
    assert "the price of a model is not known" in meter.reached()
    assert Meter(Limits(tokens=100)).reached() == ""


def test_a_study_file_sets_options_and_the_command_line_wins(tmp_path: Path) -> None:
    file = tmp_path / "study.toml"
    file.write_text(
        'agent = ["random", "blind"]\nbudgets = [5, 10]\nmax_cost = 2.5\nresume = true\nscenes = "7-9"\n', "utf-8"
    )
    assert with_config(["--config", str(file)], OPTIONS) == [
        *("--agent", "random", "--agent", "blind", "--budgets=5,10", "--max-cost=2.5", "--resume", "--scenes=7-9")
    ]
    words = with_config([f"--config={file}", "--agent", "reference", "--budgets", "20", "--", "--scenes"], OPTIONS)
    assert words == ["--max-cost=2.5", "--resume", "--scenes=7-9", *words[3:]]
    assert words[3:] == ["--agent", "reference", "--budgets", "20", "--", "--scenes"]
    assert with_config(["--scenes", "7"], OPTIONS) == ["--scenes", "7"]


def test_old_names_of_options_are_taken_with_a_note(tmp_path: Path) -> None:
    file, notes = tmp_path / "study.toml", list[str]()
    file.write_text('home-from = "logins"\n', encoding="utf-8")
    words = with_config(["--config", str(file), "--trust-edited", "--", "--home-from"], OPTIONS)
    assert with_new_names(words, notes.append) == ["--home-template=logins", "--allow-modified", "--", "--home-from"]
    assert notes == [
        "--home-from is called --home-template now; version 0.3 will not know the old name",
        "--trust-edited is called --allow-modified now; version 0.3 will not know the old name",
    ]


def test_a_command_takes_an_old_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(tmp_path / "none"), "--trust-edited"]) == 2
    first, second = capsys.readouterr().err.splitlines()
    assert first.startswith("physment-eval: --trust-edited is called --allow-modified now")
    assert "--trust-edited" not in second


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("budgetts = [5]", "there is no option 'budgetts'"),
        ("budgets = ", "is not TOML"),
        ("[models]\neffort = 1", "there is no option 'models'"),
        ("[budgets]\nx = 1", "budgets must be a value or a list"),
    ],
)
def test_a_study_file_with_an_error_is_refused(tmp_path: Path, content: str, problem: str) -> None:
    (tmp_path / "study.toml").write_text(content, encoding="utf-8")
    with pytest.raises(UsageError, match=re.escape(problem)):
        with_config(["--config", str(tmp_path / "study.toml")], OPTIONS)
    with pytest.raises(UsageError, match="--config needs a file"):
        with_config(["--config"], OPTIONS)
    with pytest.raises(UsageError, match=r"cannot be read \(No such file or directory\)$"):
        with_config(["--config", str(tmp_path / "none.toml")], OPTIONS)


def test_a_dry_run_counts_and_plays_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["run", "--agent", "random", "--agent", "blind", "--scenes", "7,9", "--budgets", "5,10", "--epochs", "3"]
    assert main([*words, "--dry-run", "--shard", "1/2", "--out", str(tmp_path / "run")]) == 0
    said = capsys.readouterr().out
    assert "2 scenes × 2 agents × 2 budgets × 1 seeds × 1 promptings × 1 protocols × 3 epochs = 24 episodes" in said
    assert re.search(r"shard 1/2: \d+ of them", said)
    assert not (tmp_path / "run").exists()


def test_the_estimate_agrees_with_what_a_model_is_sent() -> None:
    tools = [
        {"name": tool.name, "description": tool.description, "parameters": tool.input_schema}
        for tool in published_tools()
    ]
    prompts = [len(opening_prompt(Session(load_scene(files.scene_id, 0)), PromptOptions())) for files in list_packs()]
    sent = len(json.dumps(tools)) + sum(prompts) / len(prompts)
    assert sent / CHARACTERS_PER_TOKEN == pytest.approx(PROMPT_TOKENS, rel=0.1)
    assert input_tokens(3) == 3 * PROMPT_TOKENS + 3 * TURN_TOKENS


def shards(tmp_path: Path, host_url: str) -> Path:
    """A run of two shards, each played by its own command."""
    words = ["run", "--agent", "random", "--agent", "blind", "--scenes", "7,21", "--seeds", "0-2", "--server", host_url]
    for index in (1, 2):
        assert main([*words, "--shard", f"{index}/2", "--out", str(tmp_path / "study")]) == 0
    return tmp_path / "study"


def test_merged_shards_equal_a_run_that_was_not_divided(
    tmp_path: Path, host_url: str, capsys: pytest.CaptureFixture[str]
) -> None:
    study = shards(tmp_path, host_url)
    assert main(["merge", str(study), "--out", str(tmp_path / "merged")]) == 0
    words = ["run", "--agent", "random", "--agent", "blind", "--scenes", "7,21", "--seeds", "0-2", "--server", host_url]
    assert main([*words, "--out", str(tmp_path / "whole")]) == 0
    merged, whole = RunFolder(tmp_path / "merged"), RunFolder(tmp_path / "whole")
    assert {key: episode.answer for key, episode in merged.episodes().items()} == {
        key: episode.answer for key, episode in whole.episodes().items()
    }
    assert {key: record.grade for key, record in merged.grades().items()} == {
        key: record.grade for key, record in whole.grades().items()
    }
    assert [part.shard for part in merged.read_run().merged] == ["1/2", "2/2"]
    capsys.readouterr()
    assert main(["merge", str(study), "--out", str(tmp_path / "merged")]) == 2
    assert "holds a run already" in capsys.readouterr().err


def test_runs_that_do_not_belong_together_are_not_merged(
    tmp_path: Path, host_url: str, capsys: pytest.CaptureFixture[str]
) -> None:
    study = shards(tmp_path, host_url)
    part = study / "shard-1-of-2"
    twin = tmp_path / "twin"
    twin.mkdir()
    for name in ("run.json", "episodes.jsonl"):
        (twin / name).write_bytes((part / name).read_bytes())
    lines = (twin / "episodes.jsonl").read_text(encoding="utf-8").splitlines()
    other = json.loads(lines[0]) | {"started_at": "1999-01-01T00:00:00.000+00:00"}
    (twin / "episodes.jsonl").write_text("\n".join([json.dumps(other), *lines[1:]]) + "\n", encoding="utf-8")
    capsys.readouterr()
    assert main(["merge", str(study), str(twin), "--out", str(tmp_path / "m1")]) == 2
    assert "holds another record of scene" in capsys.readouterr().err
    facts = json.loads((twin / "run.json").read_text(encoding="utf-8"))
    facts["packs"]["7"] = "0" * 12
    (twin / "run.json").write_text(json.dumps(facts), encoding="utf-8")
    assert main(["merge", str(study), str(twin), "--out", str(tmp_path / "m2")]) == 2
    assert "has other packs than" in capsys.readouterr().err
    assert main(["merge", str(tmp_path / "nowhere"), "--out", str(tmp_path / "m3")]) == 2
    assert "holds neither a run nor shards" in capsys.readouterr().err


def test_a_run_stops_at_a_limit_and_can_be_continued(
    tmp_path: Path, host_url: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["run", "--agent", "random", "--scenes", "7,21", "--seeds", "0-2", "--out", str(tmp_path / "run")]
    words += ["--server", host_url]
    assert main([*words, "--max-time", "0.000001"]) == 1
    said = capsys.readouterr().err
    assert "--max-time is reached" in said
    assert "6 episodes are not played yet" in said
    assert main([*words, "--resume"]) == 0
    assert len(RunFolder(tmp_path / "run").episodes()) == 6


def test_a_changed_verdict_is_reported_and_the_old_grades_are_kept(
    tmp_path: Path, host_url: str, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "run"
    assert main(["run", "--agent", "reference", "--scenes", "7", "--server", host_url, "--out", str(folder)]) == 0
    grades = (folder / "grades.jsonl").read_text(encoding="utf-8")
    assert '"strict":"correct"' in grades
    before = grades.replace('"correct"', '"incorrect"').replace('"grader_version":"', '"grader_version":"0.')
    (folder / "grades.jsonl").write_text(before, encoding="utf-8")
    capsys.readouterr()
    assert main(["grade", str(folder)]) == 0
    said = capsys.readouterr().out
    assert "scene 7 seed 0 reference: strict incorrect → correct, normalised incorrect → correct (grader 0." in said
    assert (folder / "grades.1.jsonl").read_text(encoding="utf-8") == before
    assert (folder / "grades.jsonl").read_text(encoding="utf-8") == grades
    assert main(["grade", str(folder)]) == 0
    assert not (folder / "grades.2.jsonl").exists()
