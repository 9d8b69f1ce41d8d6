"""Tests of the generic attackers: parsing of prompts, limits, and the answers that they can and cannot find."""

from pathlib import Path

import pytest

from evaluator.agents.attackers.readings import Opening, read_opening, unit
from evaluator.agents.attackers.strategies import ATTACKERS, AttackerAgent
from evaluator.answers.engine import prompt_of
from evaluator.certify.difficulty import Drive, drive
from evaluator.certify.subject import Subject
from evaluator.certify.verify import MemoryConnector
from evaluator.episode.loop import play_episode
from evaluator.errors import UsageError
from evaluator.records.episode import Outcome
from evaluator.study.run_config import AGENTS, RunConfig, participants_of
from scenes import Category, PackFiles, find_pack
from scenes.protocol import AnswerValue
from tests.builders.author import Author
from tests.builders.records import VERSIONS, episode_key


@pytest.fixture
def author(tmp_path: Path) -> Author:
    return Author(tmp_path)


def opening_of(files: PackFiles) -> Opening:
    return read_opening(prompt_of(files, Subject.open(files).draw(0).mjcf))


async def attack(files: PackFiles, name: str, seed: int = 0) -> tuple[Drive, AnswerValue]:
    """Return an attacker's calls in a scene, and the answer key."""
    subject = Subject.open(files)
    draw = subject.draw(seed)
    return await drive(subject.session(draw), ATTACKERS[name]), subject.truth(draw)


def with_resistance_in_proportion(author: Author, task: str, asked: str, answer: float) -> PackFiles:
    """A cart whose final speed is the force divided by 2 N·s/m."""
    files = author.write(Category.HARD_SINGLE)
    author.edit(files, lambda pack: pack["derive"].update(f="0.0", c="linear", k="0.0"))
    author.edit(files, lambda pack: pack["metadata"].update(task=task))
    author.edit(files, lambda pack: pack.update(answer_spec={"kind": "number", "unit": asked}, answer=answer))
    author.replace(files.mjcf, 'frictionloss="3"', 'frictionloss="0"')
    author.replace(
        files.solution, "def theory(knobs)", f"def theory(knobs):\n    return {answer}\n\n\ndef former(knobs)"
    )
    return files


def test_an_attacker_reads_objects_limits_units_and_the_asked_case(author: Author) -> None:
    opening = opening_of(author.write(Category.HARD_SINGLE))
    assert (opening.objects, opening.sealed) == (("object_1",), frozenset())
    assert (opening.force, opening.torque, opening.calls, opening.lab_time) == (10, 0, 45, 150)
    assert opening.disabled == {"set_velocity", "move_object", "change_position"}
    assert (opening.units, opening.is_list, opening.options) == ((unit("m/s"),), False, ())
    assert (opening.asked(unit("N")), opening.asked(unit("s")), opening.named()) == ([60.0], [], ["object_1"])


def test_an_attacker_reads_lists_options_and_sealed_objects(author: Author) -> None:
    files = author.write(Category.HARD_SINGLE)
    units = {"kind": "numbers", "unit": ["m", "1"], "labels": ["way (along the rail)", "ratio"]}
    author.edit(files, lambda pack: pack.update(answer_spec=units, answer=[1, 2]))
    author.edit(files, lambda pack: pack["object_permissions"]["object_1_permissions"].update(actuate=False))
    opening = opening_of(files)
    assert (opening.units, opening.is_list, opening.sealed) == ((unit("m"), unit("1")), True, {"object_1"})
    author.edit(files, lambda pack: pack.update(answer_spec={"kind": "choice", "options": ["left", "right"]}))
    assert (opening_of(files).options, opening_of(files).units) == (("left", "right"), ())


@pytest.mark.parametrize("name", ATTACKERS)
async def test_an_attacker_keeps_the_limits_and_answers(name: str, author: Author) -> None:
    files = author.write(Category.HARD_SINGLE)
    async with MemoryConnector(files.folder.parent).open(200, 1) as client:
        episode = await play_episode(AttackerAgent(name), client, episode_key(200, seed=1), VERSIONS)
    assert episode.outcome is Outcome.ANSWERED
    refused = [exchange.text for turn in episode.turns for exchange in turn.exchanges if exchange.is_error]
    assert all("no velocity difference yet" in text for text in refused), refused
    driven, key = await attack(files, name, 1)
    assert driven.answer == episode.answer
    assert not Subject.open(files).agrees(driven.answer, key)


@pytest.mark.parametrize("name", ATTACKERS)
@pytest.mark.parametrize("scene", [7, 66, 84, 99, 101])
async def test_an_attacker_answers_in_every_kind_of_scene(scene: int, name: str) -> None:
    driven, key = await attack(find_pack(scene), name)
    assert driven.failure == ""
    assert isinstance(driven.answer, list) == isinstance(key, list | tuple)


@pytest.mark.parametrize("name", ["sweep", "proportional"])
async def test_a_response_in_proportion_to_the_force_is_carried_over(name: str, author: Author) -> None:
    files = with_resistance_in_proportion(author, "Push object_1 with 60 N. Which speed does it reach?", "m/s", 30.0)
    driven, key = await attack(files, name)
    assert driven.answer == pytest.approx(key, rel=1e-3)


async def test_the_sweep_finds_the_force_for_an_asked_speed(author: Author) -> None:
    files = with_resistance_in_proportion(author, "Which force keeps object_1 at a speed of 4 m/s?", "N", 8.0)
    driven, key = await attack(files, "sweep")
    assert driven.answer == pytest.approx(key, rel=1e-3)


async def test_the_glance_finds_a_mass_from_the_first_steps(author: Author) -> None:
    driven, key = await attack(author.write(Category.EASY_SINGLE), "glance", 2)
    assert driven.answer == pytest.approx(key, rel=1e-3)


async def test_of_objects_to_choose_from_the_fastest_is_named(author: Author) -> None:
    driven, _ = await attack(find_pack(52), "sweep")
    assert driven.answer in opening_of(find_pack(52)).options


def test_attackers_are_agents_of_a_run_and_unknown_ones_are_refused() -> None:
    assert list(participants_of(RunConfig(agents=("attacker:sweep", "attacker:glance")))) == [
        "attacker:sweep",
        "attacker:glance",
    ]
    assert f"attacker:{'|'.join(ATTACKERS)}" in AGENTS
    with pytest.raises(UsageError, match="no such attacker; they are sweep, glance, proportional"):
        participants_of(RunConfig(agents=("attacker:guess",)))


async def test_the_sweep_follows_a_power_law_beyond_its_settings(author: Author) -> None:
    files = with_resistance_in_proportion(author, "Push object_1 with 60 N. Which speed does it reach?", "m/s", 60**0.5)
    author.edit(files, lambda pack: pack["derive"].update(c="0.0", k="1.0"))
    author.replace(files.mjcf, 'density="5e-08"', 'density="50"')
    author.replace(files.mjcf, 'damping="2"', 'damping="0"')
    driven, key = await attack(files, "sweep")
    assert driven.answer == pytest.approx(key, rel=0.01)
