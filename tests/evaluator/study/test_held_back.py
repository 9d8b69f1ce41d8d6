"""Tests of held-back seeds: records contain neither seeds nor keys; the run is graded, resumed, replayed, revealed."""

import hashlib
import hmac
import json
import re
from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path

import pytest

from evaluator.answers.keys import KeyRing
from evaluator.commands.program import main
from evaluator.episode.connect import ProcessConnector
from evaluator.episode.hosts import HostConnector
from evaluator.errors import InfrastructureError
from evaluator.records.episode import Verdict
from evaluator.records.run import SeedKey
from evaluator.store.run_folder import RunFolder

KEY = "0f" * 32
SCENES = (7, 9)


@pytest.fixture
def key_file(tmp_path: Path) -> Path:
    file = tmp_path / "held-back.key"
    file.write_text(f"{KEY}\n", encoding="ascii")
    return file


@pytest.fixture
def played(tmp_path: Path, key_file: Path, host_url: str) -> Callable[..., int]:
    def run(*words: str) -> int:
        options = ["--agent", "reference", "--scenes", "7,9", "--seeds", "0-1", "--out", str(tmp_path / "run")]
        return main(["run", "--seed-key", str(key_file), *options, "--server", host_url, *words])

    return run


def test_a_seed_is_a_keyed_hash_of_scene_and_number() -> None:
    digest = hmac.new(bytes.fromhex(KEY), b"physment held-back seeds 1: 7:3", hashlib.sha256).digest()
    key = SeedKey.parse(KEY)
    assert key.seed(7, 3) == (int.from_bytes(digest[:8], "big") >> 1) + 1
    assert len({key.seed(scene, number) for scene in range(50) for number in range(50)}) == 2500
    assert key.commitment == hashlib.sha256(b"physment held-back seeds 1: " + bytes.fromhex(KEY)).hexdigest()
    assert KEY not in repr(key)


def test_records_tell_neither_seeds_nor_keys_before_they_are_revealed(
    tmp_path: Path, key_file: Path, played: Callable[..., int], capsys: pytest.CaptureFixture[str]
) -> None:
    assert played() == 0
    folder, key = RunFolder(tmp_path / "run"), SeedKey.parse(KEY)
    printed = "".join(capsys.readouterr())
    seeds = {(scene, number): key.seed(scene, number) for scene in SCENES for number in (0, 1)}
    written = printed + "".join(
        file.read_text(encoding="utf-8") for file in folder.path.rglob("*") if file.suffix != ".png" and file.is_file()
    )
    assert not [seed for seed in seeds.values() if str(seed) in written]
    assert KEY not in written
    plan = folder.read_run().plan
    assert (plan.split, plan.held_back, plan.seeds) == ("held-back", key.commitment, (0, 1))
    grades = folder.grades()
    assert all(grade.answer_key is None for grade in grades.values())
    assert {grade.grade.reason for grade in grades.values()} == {"withheld until the seeds are revealed"}
    # Right answers prove that the laboratory and the grader used the same seeds, and other values than those of seed 0.
    assert {grade.grade.strict for grade in grades.values()} == {Verdict.CORRECT}
    answers = {str(episode.answer) for episode in folder.episodes().values() if episode.key.scene == 7}
    assert str(KeyRing().key(7, 0).value) not in answers
    assert len(answers) == 2


def test_a_run_needs_its_key_until_it_is_revealed(
    tmp_path: Path, key_file: Path, played: Callable[..., int], capsys: pytest.CaptureFixture[str], host_url: str
) -> None:
    assert played() == 0
    folder = RunFolder(tmp_path / "run")
    words, with_key = [str(folder.path)], ["--seed-key", str(key_file)]
    replay = ["replay", *words, "--server", host_url]
    for command in (["grade", *words], replay, ["merge", *words, "--out", str(tmp_path / "whole")]):
        assert main(command) == 2
        assert "held-back seeds, which are not revealed yet" in capsys.readouterr().err
    assert not (tmp_path / "whole").exists()
    other = tmp_path / "other.key"
    other.write_text("1f" * 32, encoding="ascii")
    for command in (["grade", *words], replay, ["reveal-seeds", *words]):
        assert main([*command, "--seed-key", str(other)]) == 2
        assert "is not the one that" in capsys.readouterr().err
    assert main(["reveal-seeds", *words]) == 2
    assert main(["grade", *words, *with_key]) == 0
    assert main([*replay, *with_key, "--exact"]) == 0
    assert main(["report", *words]) == 0
    assert folder.grades()[next(iter(folder.grades()))].answer_key is None

    assert main(["reveal-seeds", *words, *with_key]) == 0
    assert main(["grade", *words]) == 0
    assert main([*replay, "--exact"]) == 0
    assert all(grade.answer_key is not None for grade in folder.grades().values())
    made = {"whole": ["merge", *words], "forked": ["fork", *words, "--episode", "scene=7", "--turn", "1"]}
    made["forked"] += ["--agent", "blind", "--server", host_url]
    for name, command in made.items():
        assert main([*command, "--out", str(tmp_path / name)]) == 0
        assert all(grade.answer_key is not None for grade in RunFolder(tmp_path / name).grades().values())
    capsys.readouterr()
    assert main(["reveal-seeds", *words, "--json"]) == 0
    revealed = json.loads(capsys.readouterr().out)
    assert revealed["seeds"][0] == {"scene": 7, "number": 0, "seed": SeedKey.parse(KEY).seed(7, 0)}
    disclosed = folder.path / "seed_key.json"
    disclosed.write_text(disclosed.read_text(encoding="utf-8").replace(KEY, "1f" * 32), encoding="utf-8")
    assert main(["reveal-seeds", *words]) == 2


def test_a_run_is_resumed_only_with_its_own_key(
    tmp_path: Path, key_file: Path, played: Callable[..., int], capsys: pytest.CaptureFixture[str]
) -> None:
    assert played() == 0
    folder = RunFolder(tmp_path / "run")
    whole = folder.episodes_file.read_bytes()
    folder.episodes_file.write_bytes(b"\n".join(whole.split(b"\n")[:2]) + b"\n")
    assert played("--resume", "--allow-modified") == 0
    assert len(folder.episodes()) == 4
    key_file.write_text("1f" * 32, encoding="ascii")
    capsys.readouterr()
    assert played("--resume") == 2
    assert "holds a run with other plan" in capsys.readouterr().err


@pytest.mark.parametrize("content", ["", "abc", "0f" * 31, "0g" * 32, "0f" * 33, "ü" * 64])
def test_a_file_that_holds_no_key_is_refused(tmp_path: Path, content: str, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "held-back.key"
    file.write_text(content, encoding="utf-8")
    assert main(["run", "--seed-key", str(file), "--dry-run"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


async def test_a_failure_of_the_server_does_not_tell_the_seed(
    web_server: Callable[[int, bytes], AbstractContextManager[str]],
) -> None:
    seed_of = SeedKey.parse(KEY).seed
    seed = str(seed_of(7, 1))
    script = "import sys; sys.exit(f'no such variant: {sys.argv[1:]}')"
    process = ProcessConnector(("python3", "-c", script, "{seed}"), seed_of)
    with pytest.raises(InfrastructureError, match=re.escape("(variant 1)")) as failure:
        async with process.open(7, 1):
            pass
    assert seed not in str(failure.value)
    said = json.dumps({"error": f"no draw of seed {seed}"}).encode()
    with (
        web_server(400, said) as url,
        pytest.raises(InfrastructureError, match=re.escape("no draw of seed (variant 1)")),
    ):
        async with HostConnector(url, seed_of=seed_of).open(7, 1):
            pass


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--split", "exam"], "there is no split 'exam'; the splits are train, validation, test,"),
        (["--split", "held-back"], "come from a key that its publisher keeps: run --seed-key FILE"),
        (["--split", "test", "--seed-key", "some.key"], "its seeds are those of the split held-back, not of test"),
        (["--split", "test", "--seeds", "0,20"], "--seeds 20: the split test has the seeds 0-19"),
        (
            ["--split", "test-ideas", "--scenes", "7"],
            "the split test-ideas has no scene of --scenes 7; its scenes are 8, 17, 24",
        ),
    ],
)
def test_a_selection_outside_a_split_is_refused(
    words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "--dry-run", *words]) == 2
    assert said in capsys.readouterr().err


def test_a_split_gives_scenes_and_seeds(tmp_path: Path, host_url: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "--split", "test", "--dry-run"]) == 0
    assert "105 scenes × 1 agents × 1 budgets × 20 seeds" in capsys.readouterr().out
    options = ["--agent", "random", "--scenes", "7-10", "--seeds", "1003", "--server", host_url]
    assert main(["run", "--split", "validation", *options, "--out", str(tmp_path / "run")]) == 0
    plan = RunFolder(tmp_path / "run").read_run().plan
    assert (plan.split, plan.scenes, plan.seeds, plan.held_back) == ("validation@1", (7, 9, 10), (1003,), "")
    capsys.readouterr()
    assert main(["scenes", "list", "--split", "test-ideas"]) == 0
    assert "split test-ideas@1: 20 scenes, seeds 0-19" in capsys.readouterr().out
