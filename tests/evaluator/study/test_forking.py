"""Tests that a fork contains the stored turns bit for bit, then another agent's turns, and names its origin."""

import hashlib
import json
import shutil
from pathlib import Path

import pytest

from evaluator.commands.program import main
from evaluator.episode.player import Briefing, Feedback, Reply
from evaluator.records.episode import EpisodeKey, Outcome
from evaluator.store.run_folder import RunFolder
from tests.builders.records import call

SCRIPT = {
    "turns": [
        [{"tool": "step", "arguments": {"duration": 0.2}}],
        [{"tool": "get_velocity", "arguments": {"object_id": "object_1"}}, {"tool": "fly", "arguments": {}}],
        [{"tool": "step", "arguments": {"duration": 0.4}}],
        [{"tool": "answer", "arguments": {"answer": 0.5}}],
    ]
}


class Telling:
    """An agent whose answer is the length of its prompt, so that a test can detect text that was added to it."""

    name = "telling"
    told: dict[EpisodeKey, Briefing] = {}  # noqa: RUF012 - read by tests

    def player(self, key: EpisodeKey, briefing: Briefing) -> "Telling":
        self.told[key] = briefing
        return self

    async def act(self, feedback: Feedback | None) -> Reply:
        assert feedback is None
        return Reply("I go on.", (call("step", duration=0.1), call("answer", answer=2.943)))


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory, host_url: str) -> Path:
    folder = tmp_path_factory.mktemp("forks")
    script = folder / "turns.json"
    script.write_text(json.dumps(SCRIPT["turns"]), encoding="utf-8")
    options = ["--scenes", "7", "--seeds", "0,3", "--budgets", "6", "--server", host_url, "--out", str(folder / "run")]
    assert main(["run", "--agent", f"scripted:{script}", "--agent", "random", *options]) == 0
    return folder / "run"


def forked(source: Path, out: Path, host_url: str, *words: str) -> int:
    return main(["fork", str(source), "--server", host_url, "--out", str(out), *words])


def test_a_fork_goes_on_from_the_same_evidence(source: Path, tmp_path: Path, host_url: str) -> None:
    words = ["--episode", "agent=scripted:turns", "--turn", "2", "--agent", f"{__name__}:Telling", "--agent", "blind"]
    names = {key.agent for key in RunFolder(source).episodes()}
    words[1] = f"agent={next(name for name in names if name != 'random')}"
    assert forked(source, tmp_path / "fork", host_url, *words) == 0
    folder, before = RunFolder(tmp_path / "fork"), RunFolder(source)
    lines = {json.loads(line)["key"]["seed"]: line for line in before.episode_lines() if b'"random"' not in line}
    forks = list(folder.episodes().values())
    assert {(one.key.agent, one.key.seed) for one in forks} == {(a, s) for a in ("telling", "blind") for s in (0, 3)}
    for episode in forks:
        assert episode.forked_from is not None
        stored = before.episodes()[episode.forked_from.key]
        assert episode.forked_from.turn == 2
        assert episode.forked_from.record_sha256 == hashlib.sha256(lines[episode.key.seed]).hexdigest()
        assert episode.prompt == stored.prompt
        for old, new in zip(stored.turns[:2], episode.turns[:2], strict=True):
            assert [one.model_copy(update={"duration_s": 0.0}) for one in new.exchanges] == [
                one.model_copy(update={"duration_s": 0.0}) for one in old.exchanges
            ]
            assert new.reasoning == ""
    [told] = [episode for episode in forks if episode.key.agent == "telling" and episode.key.seed == 0]
    assert [turn.reasoning for turn in told.turns] == ["", "", "I go on."]
    assert told.outcome is Outcome.ANSWERED
    record, seal = folder.read_run(), before.read_seal()
    assert record.forked_from is not None
    assert seal is not None
    assert (record.forked_from.folder, record.forked_from.seal_head) == ("run", seal.head)
    assert len(folder.grades()) == 4
    assert main(["grade", str(folder.path)]) == 0
    assert main(["report", str(folder.path)]) == 0
    assert main(["replay", str(folder.path), "--server", host_url, "--exact"]) == 0
    assert main(["submit", str(folder.path)]) == 2
    assert forked(source, folder.path, host_url, *words, "--resume") == 0
    words[3] = "1"
    assert forked(source, folder.path, host_url, *words, "--resume") == 2


def test_the_agent_is_told_what_was_done_and_what_is_left(source: Path, tmp_path: Path, host_url: str) -> None:
    from evaluator.study.forking import account

    [stored] = [one for key, one in RunFolder(source).episodes().items() if key.seed == 0 and key.agent != "random"]
    told = account(stored, 2)
    assert "2 of the 6 iterations are used up, and 4 are left" in told
    assert "step(duration=0.2) -> " in told
    assert stored.turns[1].exchanges[0].text in told
    assert "fly() -> error: " in told
    assert "0.4" not in told.partition("## Iteration 2")[0]
    assert "answer(" not in told


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--episode", "scene=8", "--turn", "1", "--agent", "blind"], "and none of them is meant"),
        (["--episode", "scene:7", "--turn", "1", "--agent", "blind"], "write conditions such as scene=7,seed=3"),
        (["--episode", "scene=7,mood=2", "--turn", "1", "--agent", "blind"], "none of them is meant"),
        (["--episode", "scene=7", "--turn", "1", "--agent", "blind"], "add agent=… to choose one"),
        (["--episode", "agent=random", "--turn", "6", "--agent", "blind"], "it can be"),
        (["--episode", "agent=random", "--turn", "1", "--agent", "nobody"], "there is no such agent"),
    ],
)
def test_what_cannot_be_forked_is_refused(
    source: Path, tmp_path: Path, host_url: str, words: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert forked(source, tmp_path / "fork", host_url, *words) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not (tmp_path / "fork").exists()


def test_a_replay_that_differs_is_refused_with_its_place(
    source: Path, tmp_path: Path, host_url: str, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = RunFolder(shutil.copytree(source, tmp_path / "run"))
    lines = [json.loads(line) for line in copy.episode_lines()]
    for line in lines:
        for exchange in line["turns"][1]["exchanges"]:
            if exchange["call"]["tool"] == "get_velocity":
                exchange["content"]["velocity"][2] *= 1 + 1e-15
    copy.episodes_file.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
    copy.seal_file.unlink()
    agent = next(line["key"]["agent"] for line in lines if line["key"]["agent"] != "random")
    words = ["--episode", f"seed=0,agent={agent}", "--turn", "2", "--agent", "blind"]
    capsys.readouterr()
    assert forked(copy.path, tmp_path / "fork", host_url, *words) == 2
    error = capsys.readouterr().err
    assert "cannot be continued: at turn 2, call 1 (get_velocity: velocity[2])" in error
    assert forked(copy.path, tmp_path / "earlier", host_url, *words[:3], "1", *words[4:]) == 0


def test_a_reply_that_is_now_refused_as_a_whole_is_no_evidence(
    source: Path, tmp_path: Path, host_url: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """The record is edited, so that it contains a call that is too long to be run."""
    copy = RunFolder(shutil.copytree(source, tmp_path / "run"))
    lines = [json.loads(line) for line in copy.episode_lines()]
    for line in lines:
        for exchange in line["turns"][0]["exchanges"]:
            exchange["call"]["arguments"]["note"] = "x" * 2_000_000
    copy.episodes_file.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
    copy.seal_file.unlink()
    agent = next(line["key"]["agent"] for line in lines if line["key"]["agent"] != "random")
    capsys.readouterr()
    words = ["--episode", f"seed=0,agent={agent}", "--turn", "2", "--agent", "blind"]
    assert forked(copy.path, tmp_path / "fork", host_url, *words) == 2
    assert "recorded calls, of which the laboratory now runs 0" in capsys.readouterr().err
