"""Tests that exports, the memory of a laboratory, and its replies contain no key and no terms of a world."""

import gc
import random
import re
import types
from pathlib import Path
from typing import Any

import pytest

import physment_mcp
from evaluator.answers.engine import all_readings
from physment_mcp.scene import load_scene
from physment_mcp.session import Session
from scenes.export import export_packs
from scenes.finding import find_pack
from scenes.worlds.acceptance import DrawnWorld
from scenes.worlds.answering import answers
from scenes.worlds.drawing import draw_constants
from scenes.worlds.expansion import expand
from scenes.worlds.experiment import Situation
from scenes.worlds.parts import Apparatus
from scenes.worlds.questions import Question
from scenes.worlds.records import Certificate, WorldRecord, as_line, keys_file, lines_file
from scenes.worlds.terms import Structure, Term
from tests.harness.fuzz.leaks import published

STRUCTURE = Structure(Apparatus.PUCK, (Term("linear drag", ("wear",)), Term("responder"), Term("wake")))
NAMES = ("linear drag", "responder", "wake", "wear")


def _made(seed: int) -> tuple[WorldRecord, Certificate]:
    """Return the same world with the constants of a seed."""
    told = Situation(Apparatus.PUCK, 6.0, 5.0, 12, 0.002)
    constants = draw_constants(STRUCTURE, random.Random(seed))
    questions = tuple(Question("strong", (1.0, y), (0.0, 0.0), (9.0, 0.0), 0.0, 1.5, "dx") for y in (0.5, 1.0, 1.5))
    key = tuple(float(f"{one:.6g}") for one in answers(STRUCTURE, constants, questions, 0.03)[:, 0])
    world = DrawnWorld(STRUCTURE, constants, told, questions, key, (0.1,) * 3)
    record = WorldRecord.of(world, 5, 0, "train", "salt-of-the-record")
    return record, Certificate(index=0, record=record.digest, key=key, bounds=world.bounds)


@pytest.fixture
def exported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of an exported world, which is what a host on another machine receives."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    record, certificate = _made(1)
    (tmp_path / "worlds").mkdir()
    lines_file(tmp_path / "worlds", 5).write_text(as_line(record) + "\n", encoding="utf-8")
    keys_file(tmp_path / "worlds", 5).write_text(as_line(certificate) + "\n", encoding="utf-8")
    export_packs(tmp_path / "exported", range(2), [record.scene_id], tmp_path / "worlds")
    return tmp_path / "exported"


def _secrets() -> list[str]:
    record, certificate = _made(1)
    written = as_line(record)
    return [*NAMES, written[20:60], *(f"{number:.5g}" for number in certificate.key)]


def test_an_exported_world_holds_no_key_and_names_no_term(exported: Path) -> None:
    files = [path for path in exported.rglob("*") if path.is_file()]
    assert [path.suffix for path in sorted(files)] == [".json", ".xml", ".xml"]
    text = "".join(path.read_text(encoding="utf-8") for path in files)
    assert [secret for secret in _secrets() if secret in text] == []


def test_the_memory_of_a_session_holds_no_key_and_names_no_term(exported: Path) -> None:
    scene = _made(1)[0].scene_id
    assert find_pack(scene, exported).folder.parent == exported
    session = Session(load_scene(scene, 0, exported))
    texts, numbers = _reachable(session)
    assert session.scene.mjcf in texts
    kept = "\n".join(texts)
    assert [secret for secret in _secrets() if secret in kept] == []
    assert not numbers & set(_made(1)[1].key)


def test_an_agent_is_not_told_which_world_it_plays(exported: Path) -> None:
    episode = physment_mcp.open_episode(_made(1)[0].scene_id, 0, scenes_dir=exported)
    assert "# Scene: World\n" in episode.prompt
    assert not re.search(rf"{_made(1)[0].scene_id}|world:|\b5:0\b", episode.prompt)


def test_other_users_read_no_kept_pack(exported: Path, tmp_path: Path) -> None:
    find_pack(_made(1)[0].scene_id, tmp_path / "worlds")
    place = tmp_path / "cache" / "physment" / "worlds"
    assert any(place.rglob("solution.py"))
    assert place.stat().st_mode & 0o077 == 0


def _reachable(start: object) -> tuple[set[str], set[float]]:
    """Return texts and numbers that an object refers to, directly or indirectly, except code and modules."""
    seen, waiting = set[int](), [start]
    texts, numbers = set[str](), set[float]()
    while waiting:
        one = waiting.pop()
        if id(one) in seen or isinstance(one, types.ModuleType | types.FunctionType | types.CodeType | type):
            continue
        seen.add(id(one))
        if isinstance(one, str):
            texts.add(one)
        elif isinstance(one, float):
            numbers.add(one)
        waiting += gc.get_referents(one)
    return texts, numbers


@pytest.mark.parametrize("seed", [2, 3])
async def test_twins_with_other_constants_look_the_same_at_the_start(seed: int, tmp_path: Path) -> None:
    told: list[dict[str, Any]] = []
    for number in (1, seed):
        record = _made(number)[0]
        expand(record, tmp_path / str(number))
        session = Session(load_scene(record.scene_id, 0, tmp_path / str(number)))
        told.append(await published(session) | dict(await all_readings(session)))
    assert told[0] == told[1]
    seen = str(told[0])
    assert [name for name in (*NAMES, "hidden_", "odo", "salt") if name in seen] == []
