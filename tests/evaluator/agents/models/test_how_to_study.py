"""Tests of the pages on studies: their files and commands, run against a server on loopback."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from evaluator.commands.program import main
from evaluator.records.episode import Outcome
from evaluator.store.run_folder import RunFolder
from tests.builders.paths import DOCS
from tests.builders.providers import Say, Service

PAGE, MACHINES, FORK, WATCH = (
    (DOCS / "how-to" / f"{name}.md").read_text(encoding="utf-8")
    for name in ("run-a-study", "many-machines", "fork-an-episode", "watch-a-run")
)
COMMAND = "physment-eval --config study.toml"
WAIT = ("step", {"duration": 0.1})


def file_of(page: str, name: str) -> str:
    (text,) = re.findall(rf"```\w+ file={re.escape(name)}\n(.*?)```", page, re.DOTALL)
    return text


def commands_of(page: str) -> list[str]:
    """Every `physment-eval` command on a page, in code blocks of any language."""
    code = "\n".join(re.findall(r"```[^\n]*\n(.*?)```", page, re.DOTALL)).replace("\\\n", " ")
    listed = re.findall(r"^ *command: \[(physment-eval.*)\]", code, re.MULTILINE)
    plain = re.findall(r"^(?:[A-Z_]+=\S+ )?(physment-eval .*)", code, re.MULTILINE)
    return [*plain, *(line.replace(",", "") for line in listed)]


def test_the_command_on_the_page_plays_a_study_of_four_budgets_fifty_at_a_time(
    openai: Service, tmp_path: Path, host_url: str
) -> None:
    assert f"```sh\n{COMMAND}\n```" in PAGE
    (tmp_path / "study.toml").write_text(file_of(PAGE, "study.toml"), encoding="utf-8")

    def reply(seen: Any) -> Any:
        return Say("Done.", [("answer", {"answer": 7.848})]) if seen.returns else Say("I wait.", [WAIT])

    openai.crowd = 50
    for _ in range(1000):
        openai.compute(reply)
    _, *words = shlex.split(COMMAND)
    done = subprocess.run(
        [sys.executable, "-m", "evaluator", *words, "--scenes", "7-20", "--server", host_url],
        cwd=tmp_path,
        env=os.environ | {"VLLM_BASE_URL": openai.url},
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stderr
    assert openai.most_under_way == 50
    episodes = RunFolder(tmp_path / "runs" / "qwen3-32b").episodes()
    assert len(episodes) == 14 * 4
    assert {key.budget for key in episodes} == {5, 10, 15, 20}
    assert {key.agent for key in episodes} == {"model:vllm:Qwen/Qwen3-32B"}
    assert {episode.outcome for episode in episodes.values()} == {Outcome.ANSWERED}
    assert {seen.body["model"] for seen in openai.seen} == {"Qwen/Qwen3-32B"}


@pytest.mark.parametrize(
    ("page", "number"), [(PAGE, 7), (MACHINES, 4), (FORK, 2), (WATCH, 2)], ids=["study", "machines", "fork", "watch"]
)
def test_every_command_on_a_page_is_valid(
    page: str, number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if "file=study.toml" in page:
        (tmp_path / "study.toml").write_text(file_of(page, "study.toml"), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    for name in ("OPENAI_API_KEY", "ANTHROPIC_API_KEY"):
        monkeypatch.setenv(name, "sk-loopback")
    commands = commands_of(page)
    assert len(commands) == number
    for command in commands:
        _, *words = shlex.split(command)
        if words[0] not in {"merge", "fork", "watch"}:
            assert main([*words, "--dry-run"]) == 0, command
            assert "episodes at a time" in capsys.readouterr().out


def test_the_shards_on_the_page_are_merged_into_the_study(
    openai: Service, tmp_path: Path, host_url: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "study.toml").write_text(file_of(MACHINES, "study.toml"), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("VLLM_BASE_URL", openai.url)
    for _ in range(100):
        openai.say("I know.", [("answer", {"answer": 7.848})])
    (job,) = re.findall(r"^physment-eval (.*)", file_of(MACHINES, "study.sbatch"), re.MULTILINE)
    (merge,) = [command for command in commands_of(MACHINES) if " merge " in command]
    for index in (1, 2):
        for name, value in {"ID": index, "MIN": 1, "STEP": 1, "COUNT": 2}.items():
            monkeypatch.setenv(f"SLURM_ARRAY_TASK_{name}", str(value))
        assert main([*shlex.split(job), "--scenes", "7,21", "--server", host_url]) == 0
    assert main(shlex.split(merge)[1:]) == 0
    shards = [RunFolder(tmp_path / "runs" / "qwen3-32b" / f"shard-{index}-of-2").episodes() for index in (1, 2)]
    merged = RunFolder(tmp_path / "runs" / "qwen3-32b-whole").episodes()
    assert len(shards[0]) + len(shards[1]) == len(merged) == 8
