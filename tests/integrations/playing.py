"""Shared by the tests of all integrations: a referee with a run folder, the scripted model, and the expected play."""

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Generator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import anyio
import pytest

from evaluator.answers.keys import KeyRing
from evaluator.episode.connect import ProcessConnector
from evaluator.episode.loop import play_episode
from evaluator.records.episode import Episode, Grade
from evaluator.scores.scoring import grade_record
from evaluator.store.run_folder import RunFolder
from scenes.splits import splits
from tests.builders.paths import ROOT
from tests.builders.records import VERSIONS, episode_key
from tests.harness.clients.playing import LABORATORY, Rehearsed, canonical, exchanges_of
from tests.harness.clients.scripted_model import KEY, app, serving

ENVIRONMENTS = Path(os.environ.get("PHYSMENT_INTEGRATIONS") or ROOT / ".integrations")
"""Folder in which `python -m tests.harness.frameworks` creates an environment for each integration."""


@dataclass(frozen=True)
class Stand:
    """A test stand: a referee, a model, and the episodes that the referee recorded."""

    referee: str
    model: str
    folder: RunFolder
    programs: Path
    """Folder of the programs of the integration's environment."""
    scratch: Path

    def run(self, program: str, *words: object, **variables: str) -> subprocess.CompletedProcess[str]:
        """Run a program of the integration's environment to its end."""
        return subprocess.run(
            [str(self.programs / program), *map(str, words)],
            cwd=self.scratch, env=self.environment() | variables,
            capture_output=True, text=True, check=False, timeout=3600,
        )  # fmt: skip

    def environment(self) -> dict[str, str]:
        """Environment variables of the integration's programs, without paths to this project's packages."""
        kept = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        ours = {"PHYSMENT_REFEREE_URL": self.referee, "OPENAI_BASE_URL": f"{self.model}/v1", "OPENAI_API_KEY": KEY}
        return {**kept, **ours, "PATH": f"{self.programs}{os.pathsep}{os.environ['PATH']}"}

    def episodes(self) -> dict[tuple[int, int, int], Episode]:
        """Scene, seed and budget → the episode that the referee recorded."""
        return {(key.scene, key.seed, key.budget): episode for key, episode in self.folder.episodes().items()}


@contextlib.contextmanager
def standing(integration: str, scratch: Path, *options: str) -> Generator[Stand]:
    """Create a test stand for an integration; skips the test if its environment is missing.

    Args:
        integration: Name of its environment.
        scratch: Folder for the run folder of the referee, and for files of the integration.
        options: Further options of the referee.
    """
    programs = ENVIRONMENTS / integration / "bin"
    if not programs.is_dir():
        pytest.skip(f"{integration} is not installed; `python -m tests.harness.frameworks {integration}` installs it")
    folder = RunFolder(scratch / "run")
    command = [sys.executable, "-m", "evaluator", "referee", "--port", "0", "--out", str(folder.path), *options]
    with serving(app()) as model, subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            address = json.loads(process.stdout.readline())["listening"]
            yield Stand(address, model, folder, programs, scratch)
        finally:
            process.terminate()
            process.communicate(timeout=120)


def rehearsed(scene: int, seed: int, budget: int = 20) -> Episode:
    """Play the scripted model with `physment-eval`; its episode is the expected one."""

    async def play() -> Episode:
        key = episode_key(scene, seed=seed, agent="rehearsed", budget=budget)
        async with ProcessConnector(LABORATORY).open(scene, seed) as client:
            return await play_episode(Rehearsed(), client, key, VERSIONS)

    return anyio.run(play)


def grade_of(episode: Episode) -> Grade:
    """The grade of `physment-eval`."""
    return grade_record(episode, KeyRing()).grade


def check_same(recorded: Episode, ours: Episode) -> None:
    """Check that an episode has the prompt, calls, results, outcome, answer and grade of the expected one."""
    assert recorded.prompt == ours.prompt
    assert list(map(canonical, exchanges_of(recorded))) == list(map(canonical, exchanges_of(ours)))
    assert (recorded.outcome, recorded.answer) == (ours.outcome, ours.answer)
    assert grade_of(recorded) == grade_of(ours)


def place_of(scene: int, seed: int) -> int:
    """Return the index of a variant in the split `train`."""
    train = splits()["train"]
    return train.scenes.index(scene) + len(train.scenes) * train.seeds.index(seed)


def json_lines(file: Path) -> list[Mapping[str, Any]]:
    """Parse a file that contains one JSON object per line."""
    return [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
