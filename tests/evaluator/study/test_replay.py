"""Tests of replay: equal calls give equal results, and a changed laboratory is detected."""

import json
import shutil
from pathlib import Path

import anyio
import pytest

from evaluator.agents.recorded import RecordedAgent, load_recorded
from evaluator.agents.reference import ScriptedAgent
from evaluator.certify.verify import MemoryConnector
from evaluator.commands.program import main
from evaluator.episode.loop import play_episode
from evaluator.episode.player import Agent
from evaluator.errors import UsageError
from evaluator.records.episode import Episode, EpisodeKey, Outcome
from evaluator.store.run_folder import RunFolder
from evaluator.study.replay import differences
from scenes import default_folder
from tests.builders.records import VERSIONS, call, episode_key

SCENE = 7


TURNS = (
    (call("step", duration=0.2), call("get_position", object_id="object_1"), call("get_velocity", object_id="nothing")),
    (),
    (call("fly"), call("step", duration=0.1)),
    (call("answer", answer=1.5), call("step", duration=0.1)),
)


def key(agent: str = "someone", budget: int = 6) -> EpisodeKey:
    return episode_key(SCENE, agent=agent, budget=budget)


@pytest.fixture(scope="module")
def stored() -> Episode:
    async def play() -> Episode:
        return await replayed(ScriptedAgent("someone", {None: TURNS}))

    return anyio.run(play)


@pytest.fixture
def folder(tmp_path: Path, stored: Episode) -> RunFolder:
    run = RunFolder(tmp_path / "run")
    run.create(resume=False)
    run.append_episode(stored)
    return run


async def replayed(agent: Agent, scenes_dir: Path | None = None) -> Episode:
    async with MemoryConnector(scenes_dir).open(SCENE, 0) as client:
        return await play_episode(agent, client, key(), VERSIONS)


async def test_a_replay_makes_the_same_calls_and_gets_the_same_returns(folder: RunFolder, stored: Episode) -> None:
    now = await replayed(load_recorded(folder.path))
    assert [[exchange.call for exchange in turn.exchanges] for turn in now.turns] == [list(turn) for turn in TURNS]
    assert (now.outcome, now.answer) == (Outcome.ANSWERED, 1.5)
    assert list(differences(stored, now, rel_tol=0.0)) == []


def tampered(episode: Episode, turn: int, index: int, **changes: object) -> Episode:
    exchange = episode.turns[turn].exchanges[index].model_copy(update=changes)
    exchanges = list(episode.turns[turn].exchanges)
    exchanges[index] = exchange
    turns = list(episode.turns)
    turns[turn] = turns[turn].model_copy(update={"exchanges": tuple(exchanges)})
    return episode.model_copy(update={"turns": tuple(turns)})


def test_each_kind_of_difference_is_reported_with_its_place(stored: Episode) -> None:
    content = dict(stored.turns[0].exchanges[1].content or {})
    position = content["position"]
    moved = [position[0], position[1], position[2] + 1e-3]
    near = [position[0], position[1], position[2] * (1 + 1e-12)]
    [found] = differences(stored, tampered(stored, 0, 1, content=content | {"position": moved}))
    assert (found.turn, found.call, found.what) == (1, 2, "get_position: position[2]")
    assert (found.stored, found.now) == (position[2], moved[2])
    close = tampered(stored, 0, 1, content=content | {"position": near})
    assert list(differences(stored, close)) == []
    assert [found.what for found in differences(stored, close, rel_tol=0.0)] == ["get_position: position[2]"]
    short = {name: value for name, value in content.items() if name != "position"}
    [missing] = differences(stored, tampered(stored, 0, 1, content=short))
    assert (missing.what, missing.now) == ("get_position: position", "(nothing)")
    [refused] = differences(stored, tampered(stored, 0, 0, is_error=True, text="no"))
    assert (refused.what, refused.now) == ("step", "returned, an error: no")
    [worded] = differences(stored, tampered(stored, 0, 2, text="otherwise"))
    assert (worded.call, worded.now) == (3, "otherwise")
    [prompt] = differences(stored, stored.model_copy(update={"prompt": "Another task."}))
    assert (prompt.turn, prompt.what) == (0, "opening prompt")
    cut = stored.model_copy(update={"turns": stored.turns[:3], "outcome": Outcome.AGENT_ERROR})
    assert [(found.turn, found.what) for found in differences(stored, cut)] == [(4, "turn")]


async def test_a_reply_that_is_now_refused_as_a_whole_is_a_difference(stored: Episode) -> None:
    """The record is edited, so that it contains a call that is too long to be run."""
    long = call("answer", answer="x" * 2_000_000)
    turns = list(stored.turns)
    exchanges = tuple(one.model_copy(update={"call": long}) for one in turns[0].exchanges)
    turns[0] = turns[0].model_copy(update={"exchanges": exchanges})
    edited = stored.model_copy(update={"turns": tuple(turns)})
    now = await replayed(RecordedAgent("someone", (edited,)))
    assert now.turns[0].exchanges == ()
    (found,) = differences(edited, now)
    assert (found.turn, found.call, found.what, found.stored, found.now) == (1, 0, "turn", "3 calls", "0 calls")


async def test_a_scene_without_a_record_is_an_agent_error(stored: Episode) -> None:
    other = stored.model_copy(update={"key": key(budget=5)})
    assert "no transcript is stored for scene 7" in ((await replayed(RecordedAgent("replay:x", (other,)))).error or "")
    two = (stored, stored.model_copy(update={"key": key("another")}))
    agent = RecordedAgent("replay:x", tuple(episode.model_copy(update={"key": episode.key}) for episode in two))
    async with MemoryConnector().open(SCENE, 0) as client:
        unnamed = await play_episode(agent, client, key("replay:x"), VERSIONS)
    assert "of someone, another" in (unnamed.error or "")
    assert (await replayed(agent)).outcome is Outcome.ANSWERED


def test_a_folder_without_episodes_cannot_be_replayed(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no transcript"):
        load_recorded(tmp_path)


def test_the_command_finds_no_difference_in_the_same_laboratory(
    folder: RunFolder, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", str(folder.path)]) == 0
    assert "1 episodes, 4 calls compared: 1 episodes the same, 0 differences" in capsys.readouterr().out


def test_the_command_shows_the_effect_of_a_changed_pack(
    folder: RunFolder, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    packs = tmp_path / "packs"
    shutil.copytree(default_folder() / f"Scene{SCENE}", packs / f"Scene{SCENE}")
    world = packs / f"Scene{SCENE}" / f"scene{SCENE}.xml"
    text = world.read_text(encoding="utf-8")
    assert "<option" in text
    world.write_text(text.replace("<option", '<option density="500"', 1), encoding="utf-8")
    assert main(["replay", str(folder.path), "--scenes-dir", str(packs), "--json"]) == 1
    said = json.loads(capsys.readouterr().out)
    assert (said["episodes"], said["not_played"]) == (1, [])
    assert any(found["what"].startswith("get_position: position") for found in said["differences"])
    assert main(["replay", str(folder.path), "--scenes-dir", str(packs)]) == 1
    assert "get_position: position" in capsys.readouterr().out


def test_an_episode_that_cannot_be_played_fails_the_command(
    folder: RunFolder, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    packs = tmp_path / "packs"
    shutil.copytree(default_folder() / "Scene9", packs / "Scene9")
    assert main(["replay", str(folder.path), "--scenes-dir", str(packs)]) == 1
    assert "not played" in capsys.readouterr().out
