"""Tests with the real OpenEnv: the same calls, results, outcome and grade as with `physment-eval`."""

import contextlib
import json
import socket
import subprocess
import time
from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.builders.paths import ROOT
from tests.integrations.playing import Stand, check_same, grade_of, place_of, rehearsed, standing

PROGRAM = Path(__file__).parent / "programs" / "openenv_agent.py"
SESSION = PROGRAM.with_name("openenv_session.py")


@dataclass(frozen=True)
class Served:
    """An OpenEnv server on a stand."""

    stand: Stand
    url: str

    def played(self, budget: int, *variants: dict[str, Any]) -> list[dict[str, Any]]:
        """Play episodes and return the program's output for each."""
        done = self.stand.run("python", PROGRAM, self.url, self.stand.model, budget, *map(json.dumps, variants))
        assert done.returncode == 0, done.stderr[-2000:]
        return [json.loads(line) for line in done.stdout.splitlines()]


def free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        return listener.getsockname()[1]


@contextlib.contextmanager
def serving_openenv(stand: Stand, **variables: str) -> Generator[str]:
    url = f"http://127.0.0.1:{(port := free_port())}"
    command = [str(stand.programs / "server"), "--port", str(port)]
    with subprocess.Popen(command, cwd=stand.scratch, env=stand.environment() | variables) as process:
        try:
            while process.poll() is None:
                with contextlib.suppress(httpx.TransportError):
                    httpx.get(f"{url}/health").raise_for_status()
                    break
                time.sleep(0.1)
            yield url
        finally:
            process.terminate()


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Generator[Served]:
    with standing("openenv", tmp_path_factory.mktemp("openenv")) as stand, serving_openenv(stand) as url:
        yield Served(stand, url)


def test_an_episode_in_openenv_has_the_same_calls_returns_outcome_and_grade_as_here(served: Served) -> None:
    place = place_of(23, 10_004)
    told = served.played(20, {"scene": 20, "seed": 3}, {"split": "train", "index": place})
    assert [(said["state"]["split"], said["state"]["index"]) for said in told] == [(None, None), ("train@1", place)]
    for said, scene, seed in zip(told, (20, 23), (3, 10_004), strict=True):
        ours = rehearsed(scene, seed)
        check_same(served.stand.episodes()[scene, seed, 20], ours)
        grade = grade_of(ours)
        assert said["verdict"] == {"strict": grade.strict, "normalised": grade.normalised, "graded": grade.graded}
        *before, last = said["rewards"]
        assert (last, said["outcome"], said["tools"]) == (1.0, ours.outcome, 26)
        assert set(before) == {None}
        assert (said["state"]["step_count"], said["state"]["done"]) == (len(ours.turns), True)
        assert "seed" not in said["state"]


def test_the_last_action_of_the_budget_ends_the_episode(served: Served) -> None:
    (said,) = served.played(4, {"scene": 23, "seed": 5})
    check_same(served.stand.episodes()[23, 5, 4], rehearsed(23, 5, budget=4))
    assert (said["rewards"], said["outcome"]) == ([None] * 4 + [0.0], "budget_exhausted")


def test_worlds_and_draws_from_a_curriculum_are_opened(served: Served) -> None:
    of_level, drawn = served.played(
        1, {"world": {"level": 1}, "index": 0}, {"curriculum": "c", "split": "train", "random_seed": 1}
    )
    assert of_level["state"]["world"] == "world:1:0"
    assert (drawn["state"]["world"], drawn["state"]["split"]) == (None, "train@1")
    window = httpx.get(f"{served.stand.referee}/curricula/c").json()
    assert drawn["state"]["scene"] in window["steps"][0]


def test_a_harness_of_openenv_plays_sessions_with_the_same_episode_and_grade_as_here(served: Served) -> None:
    stand = served.stand
    done = stand.run("python", SESSION, stand.model, 30, '{"budget": 30}', '{"scene": 20, "seed": 5}')
    (said,) = map(json.loads, done.stdout.splitlines())
    ours = rehearsed(20, 5, budget=30)
    check_same(stand.episodes()[20, 5, 30], ours)
    assert (said["done"], said["tools"], said["refused"], said["rewards"]) == (True, 26, 3, [1.0, 1.0])
    assert said["metrics"] == {"strict": "correct", "graded": 1.0, "outcome": "answered", "calls": said["calls"]}
    assert said["calls"] == len(ours.turns)


def test_the_seed_of_a_group_draws_the_variant_of_a_session(served: Served) -> None:
    """The sessions get seeds instead of tasks, because rows of `AsyncGRPOTrainer` contain only prompts."""
    stand = served.stand
    before = len(stand.folder.episodes())
    done = stand.run("python", SESSION, stand.model, 1, '{"split": "train", "budget": 1}', "3", "3", "4")
    said = [json.loads(line) for line in done.stdout.splitlines()]
    assert [one["rewards"] for one in said] == [[0.0, 0.0]] * 3
    assert {one["metrics"]["outcome"] for one in said} == {"budget_exhausted"}
    first, second, third = [(key.scene, key.seed) for key in list(stand.folder.episodes())[before:]]
    assert first == second != third
    assert httpx.get(f"{stand.referee}/healthz").json()["episodes"] == 0


def test_openenv_finds_the_package_and_the_running_server_valid(served: Served) -> None:
    for words in (["--url", served.url], [ROOT / "integrations" / "openenv", "--level", "static"]):
        done = served.stand.run("openenv", "validate", *words)
        assert (done.returncode, done.stdout.splitlines()[-1]) == (0, "Verdict: PASS"), done.stdout


def test_a_session_that_ends_early_leaves_no_episode_open(served: Served) -> None:
    reset = httpx.post(f"{served.url}/reset", json={"seed": 1, "scene": 7})
    assert reset.json()["observation"]["prompt"]
    assert httpx.get(f"{served.stand.referee}/healthz").json()["episodes"] == 0


def test_what_cannot_be_opened_or_done_is_said_in_one_sentence(served: Served) -> None:
    code = """if True:
        from physment_openenv import PhysmentAction, PhysmentEnv
        with PhysmentEnv(base_url={url!r}).sync() as env:
            for ask in (lambda: env.step(PhysmentAction(tool="step")), lambda: env.reset(scene=9999)):
                try:
                    ask()
                except RuntimeError as error:
                    print(error)
    """
    first, second = served.stand.run("python", "-c", code.format(url=served.url)).stdout.splitlines()
    assert "no episode is open: reset first" in first
    assert "no scene 9999" in second
    with serving_openenv(served.stand, PHYSMENT_REFEREE_URL="http://127.0.0.1:9") as url:
        (alone,) = served.stand.run("python", "-c", code.format(url=url)).stdout.splitlines()[1:]
    assert "start `physment-eval referee`" in alone


def test_another_version_of_openenv_is_refused_in_one_sentence(served: Served) -> None:
    code = "import importlib.metadata as m; m.version = lambda name: '0.11.0'; import physment_openenv"
    assert served.stand.run("python", "-c", code).stderr.splitlines()[-1] == (
        "ImportError: physment-openenv is tested with openenv 0.10 and not with 0.11.0: pip install 'openenv==0.10.*'"
    )
