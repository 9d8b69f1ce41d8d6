"""Tests with the real NeMo Gym: the same calls, results, outcome and grade as with `physment-eval`."""

import json
from collections.abc import Generator
from pathlib import Path

import pytest

from tests.builders.paths import ROOT
from tests.integrations.playing import Stand, check_same, grade_of, place_of, rehearsed, standing

PROGRAM = Path(__file__).parent / "programs" / "nemo_gym_agent.py"
SERVER = ROOT / "integrations" / "nemo_gym" / "resources_servers" / "physment"


@pytest.fixture(scope="module")
def stand(tmp_path_factory: pytest.TempPathFactory) -> Generator[Stand]:
    with standing("nemo_gym", tmp_path_factory.mktemp("nemo_gym")) as opened:
        yield opened


def dataset(stand: Stand, name: str, *words: object) -> Path:
    """Let the command of `physment-nemo-gym` write a dataset; returns the file."""
    done = stand.run("python", "-m", "physment_nemo_gym.dataset", *words)
    assert done.returncode == 0, done.stderr
    file = stand.scratch / name
    file.write_text(done.stdout, encoding="utf-8")
    return file


@pytest.mark.parametrize(
    ("budget", "reward", "named"),
    [
        (20, 1.0, ["--scenes", "20,23", "--seeds", "10003"]),
        (5, 0.0, ["--split", "train", "--indices", f"{place_of(20, 10_003)},{place_of(23, 10_003)}"]),
    ],
)
def test_a_row_in_nemo_gym_has_the_same_calls_returns_outcome_and_grade_as_here(
    stand: Stand, budget: int, reward: float, named: list[str]
) -> None:
    rows = dataset(stand, f"rows{budget}.jsonl", *named, "--budget", budget)
    done = stand.run("python", PROGRAM, stand.model, rows)
    said = [json.loads(line) for line in done.stdout.splitlines()]
    assert len(said) == 2, done.stderr[-2000:]
    for one, scene in zip(said, (20, 23), strict=True):
        ours = rehearsed(scene, 10_003, budget)
        check_same(stand.episodes()[scene, 10_003, budget], ours)
        assert (one["reward"], one["outcome"], one["graded"]) == (reward, ours.outcome, grade_of(ours).graded)


def test_the_fixture_tests_of_the_server_pass(stand: Stand) -> None:
    done = stand.run("python", "-m", "pytest", "-q", "-p", "no:cacheprovider", SERVER / "tests")
    assert done.returncode == 0, done.stdout[-2000:]
    assert "3 passed" in done.stdout or done.stdout.startswith("...")


def test_a_dataset_that_cannot_be_written_is_refused_in_one_sentence(stand: Stand) -> None:
    for words, says in (
        (["--scenes", "x"], "write whole numbers"),
        (["--scenes", "9999"], "no scene 9999"),
        (["--split", "x", "--indices", "0"], "no split"),
    ):
        done = stand.run("python", "-m", "physment_nemo_gym.dataset", *words)
        assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)
        assert says in done.stderr


def test_another_version_of_nemo_gym_is_refused_in_one_sentence(stand: Stand) -> None:
    code = "import importlib.metadata as m; m.version = lambda name: '0.5.0'; import physment_nemo_gym"
    assert stand.run("python", "-c", code).stderr.splitlines()[-1] == (
        "ImportError: physment-nemo-gym is tested with nemo-gym 0.4 and not with 0.5.0: pip install 'nemo-gym==0.4.*'"
    )
