"""Tests of making, caching, opening and verifying worlds; a laboratory gets no key of a world."""

import json
import random
import re
from pathlib import Path

import numpy as np
import pytest

import physment_mcp
from evaluator.certify.worlds import fault_of, make_world
from physment_mcp.scene import load_scene
from physment_mcp.serving.prompts import opening_prompt
from physment_mcp.serving.views import view_of
from physment_mcp.session import Session
from physment_mcp.visibility import cached_visibility
from scenes.errors import WorldError
from scenes.world_names import reference_of
from scenes.worlds.acceptance import IDENTIFIABLE, DrawnWorld, Maker
from scenes.worlds.drawing import SPLITS, draw_constants, draw_structure, split_of
from scenes.worlds.expansion import expand
from scenes.worlds.experiment import TURNS, Situation
from scenes.worlds.levels import GRAMMAR, LEVELS, difficulty_of
from scenes.worlds.orders import PUBLIC
from scenes.worlds.packs import pack_of
from scenes.worlds.parts import Apparatus
from scenes.worlds.questions import Question
from scenes.worlds.records import (
    Certificate,
    WorldRecord,
    as_line,
    keys_file,
    lines_file,
    read_certificates,
    read_records,
)
from scenes.worlds.tasks import task_of
from scenes.worlds.terms import Structure, Term

LEVEL = 1


@pytest.fixture(scope="module")
def made() -> tuple[WorldRecord, Certificate]:
    """A world of a low level."""
    found = make_world(LEVEL, difficulty_of(LEVEL), PUBLIC, 0)
    return found.record, found.certificate


def test_the_same_index_gives_the_same_world(made: tuple[WorldRecord, Certificate]) -> None:
    again = make_world(LEVEL, difficulty_of(LEVEL), PUBLIC, 0)
    assert (again.record, again.certificate) == made
    other = make_world(LEVEL, difficulty_of(LEVEL), "another secret", 0)
    assert other.record.constants != made[0].constants
    assert other.record.split == "held-back"


def test_an_accepted_world_is_proved(made: tuple[WorldRecord, Certificate]) -> None:
    record, certificate = made
    assert fault_of(record, certificate) is None
    assert 0 < max(certificate.bounds) <= IDENTIFIABLE
    assert max(certificate.engine) < 1e-2
    assert split_of(record.apparatus, [term.kind for term in record.structure.terms]) == record.split == "train"


@pytest.mark.parametrize("change", ["key", "record", "constant"])
def test_a_changed_world_is_found_out(made: tuple[WorldRecord, Certificate], change: str) -> None:
    record, certificate = made
    if change == "key":
        certificate = certificate.model_copy(update={"key": tuple(number * 1.01 for number in certificate.key)})
    elif change == "record":
        record = record.model_copy(update={"salt": "other"})
    else:
        record = record.model_copy(update={"constants": record.constants | {"m": record.constants["m"] * 1.02}})
        certificate = certificate.model_copy(update={"record": record.digest})
    assert fault_of(record, certificate) is not None


def test_records_survive_their_file(made: tuple[WorldRecord, Certificate], tmp_path: Path) -> None:
    record, certificate = made
    lines_file(tmp_path, LEVEL).write_text(as_line(record) + "\n" + as_line(record)[:40], encoding="utf-8")
    keys_file(tmp_path, LEVEL).write_text(as_line(certificate) + "\n", encoding="utf-8")
    assert list(read_records(tmp_path, LEVEL)) == [record]  # an incomplete line is no record yet
    assert list(read_certificates(tmp_path, LEVEL)) == [certificate]
    assert len(as_line(record)) + len(as_line(certificate)) < 2000


def test_a_line_that_is_no_record_is_named(tmp_path: Path) -> None:
    lines_file(tmp_path, LEVEL).write_text('{"level": 1}\n', encoding="utf-8")
    with pytest.raises(WorldError, match=r"level-1\.jsonl, line 1: grammar: Field required"):
        list(read_records(tmp_path, LEVEL))
    with pytest.raises(WorldError, match="there are no such worlds"):
        list(read_records(tmp_path, 4))


def test_a_laboratory_opens_a_world_and_holds_no_key(made: tuple[WorldRecord, Certificate], tmp_path: Path) -> None:
    record, certificate = made
    files = expand(record, tmp_path)
    texts = [path.read_text(encoding="utf-8") for path in files.folder.iterdir()]
    assert {path.name for path in files.folder.iterdir()} == {
        f"scene{record.scene_id}.public.json",
        f"scene{record.scene_id}.seed0.xml",
    }
    for number in certificate.key:
        assert not any(f"{number:.5g}" in text for text in texts)
    assert not any(term.form in text for term in record.structure.terms if " " in term.form for text in texts)
    episode = physment_mcp.open_episode(record.scene_id, 0, scenes_dir=tmp_path)
    assert task_of(record) in episode.prompt
    push = (
        {"force_vector": [1.0, 0.0, 0.0]}
        if record.apparatus is not Apparatus.WHEEL
        else {"torque_vector": [0.0, 0.0, 1.0]}
    )
    episode.call(
        "apply_force" if record.apparatus is not Apparatus.WHEEL else "apply_torque", object_id="object_1", **push
    )
    episode.call("step", duration=0.45)
    assert episode.call("get_velocity", object_id="object_1")


def test_the_noise_depends_on_the_secret_of_the_record(made: tuple[WorldRecord, Certificate], tmp_path: Path) -> None:
    seen: list[object] = []
    for salt in ("one", "two", "one"):
        folder = tmp_path / f"{len(seen)}"
        expand(made[0].model_copy(update={"salt": salt}), folder)
        episode = physment_mcp.open_episode(made[0].scene_id, 0, scenes_dir=folder)
        seen.append(episode.call("get_velocity", object_id="object_1"))
    assert seen[0] == seen[2]
    assert seen[0] != seen[1]


def test_a_grader_finds_the_key_and_a_strange_certificate_is_refused(
    made: tuple[WorldRecord, Certificate], tmp_path: Path
) -> None:
    record, certificate = made
    files = expand(record, tmp_path, certificate)
    assert json.loads(files.json.read_text(encoding="utf-8"))["answer"] == list(certificate.key)
    with pytest.raises(WorldError, match="that of another record"):
        expand(record, tmp_path, certificate.model_copy(update={"record": "other"}))


def test_a_folder_that_cannot_be_written_is_said_in_a_sentence(
    made: tuple[WorldRecord, Certificate], tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(WorldError, match="cannot keep the packs of worlds: Not a directory"):
        expand(made[0], tmp_path / "file")


@pytest.mark.parametrize("level", LEVELS)
def test_structures_of_a_level_have_the_parts_that_it_says(level: int) -> None:
    difficulty, rng = difficulty_of(level), random.Random(level)
    for _ in range(20):
        structure = draw_structure(difficulty, rng)
        assert len(structure.terms) <= difficulty.terms
        assert sum(len(term.modulations) for term in structure.terms) == difficulty.modulations
        assert len(structure.hidden) <= difficulty.hidden


def test_splits_share_no_combination_of_forms() -> None:
    rng, found = random.Random(1), dict[str, set[str]]()
    for split, _ in SPLITS:
        structures = [draw_structure(difficulty_of(5), rng, split) for _ in range(30)]
        found[split] = {f"{one.apparatus}{sorted({term.form for term in one.terms})}" for one in structures}
    assert all(not found[one] & found[other] for one in found for other in found if one != other)


def test_a_world_that_nobody_can_solve_is_not_made() -> None:
    difficulty = difficulty_of(2).changed(looks=12, noise=0.1, bound=0.0)
    with pytest.raises(WorldError, match=r"none of 5 draws was accepted"):
        Maker(difficulty, random.Random(3)).world(5)


@pytest.mark.parametrize(
    ("attribute", "sentence"),
    [
        ({"terms": 9}, "terms must be from 1 to 6, not 9"),
        ({"colour": 1}, "no attribute 'colour'"),
        ({"kinds": ()}, "kinds"),
    ],
)
def test_an_attribute_out_of_range_is_refused(attribute: dict[str, object], sentence: str) -> None:
    with pytest.raises(WorldError, match=sentence):
        difficulty_of(2).changed(**attribute)


def test_a_reference_stands_for_a_scene_id(made: tuple[WorldRecord, Certificate]) -> None:
    assert reference_of(made[0].scene_id) == f"world:{LEVEL}:0"
    assert reference_of(111) == "111"


def test_a_task_asks_in_the_units_of_the_answer(made: tuple[WorldRecord, Certificate]) -> None:
    pack = pack_of(*made)
    assert pack.answer_spec is not None
    assert np.shape(pack.answer) == (3,)
    units = re.findall(r"[ABC] (?:in (\S+?)|the number of a term)[,.]", pack.metadata.task.splitlines()[-1])
    assert [unit or "1" for unit in units] == list(pack.answer_spec.unit or ())


@pytest.mark.parametrize("looks", [12, 34, 46, 90])
def test_a_course_fits_into_the_iterations_of_an_episode(looks: int) -> None:
    told = Situation(Apparatus.PUCK, 6.0, 5.0, looks, 0.002)
    assert len(told.turns) <= TURNS
    assert sum(told.turns) == told.legs


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"grammar": GRAMMAR + 1}, f"grammar: Input should be less than or equal to {GRAMMAR}"),
        ({"level": 4}, "holds a world of level 4"),
        ({"terms": [["tractor beam", []]]}, "has no such part; is the record of a newer version"),
        ({"constants": {"m": 1.0}}, "the constants are not those of the terms"),
        ({"noise": -1}, "noise: Input should be greater than or equal to 0"),
        ({"questions": [{"kind": "far", "place": [1], "speed": [], "push": [], "clock": 0, "lasting": 1, "what": "u"}]},
         "a question needs"),
    ],
)  # fmt: skip
def test_a_record_that_cannot_be_used_is_refused_in_a_sentence(
    made: tuple[WorldRecord, Certificate], tmp_path: Path, change: dict[str, object], sentence: str
) -> None:
    line = json.dumps(json.loads(as_line(made[0])) | change)
    lines_file(tmp_path, LEVEL).write_text(line + "\n", encoding="utf-8")
    with pytest.raises(WorldError, match=sentence):
        list(read_records(tmp_path, LEVEL))


def test_pictures_and_the_app_show_nothing_hidden_of_a_world(tmp_path: Path) -> None:
    structure = Structure(Apparatus.PUCK, (Term("linear drag", ("wear",)), Term("responder"), Term("wake")))
    told = Situation(Apparatus.PUCK, 6.0, 5.0, 12, 0.002)
    constants = draw_constants(structure, random.Random(1))
    question = Question("strong", (1.0, 1.0), (0.0, 0.0), (9.0, 0.0), 0.0, 1.5, "dx")
    world = DrawnWorld(structure, constants, told, (question,) * 3, (1.0,) * 3, (0.1,) * 3)
    record = WorldRecord.of(world, 5, 0, "train", "salt")
    certificate = Certificate(index=0, record=record.digest, key=world.key, bounds=world.bounds)
    files = expand(record, tmp_path, certificate)
    session = Session(load_scene(files.scene_id, 0, tmp_path))
    view = view_of(session, cached_visibility(tmp_path)(session.scene))
    drawn = {body["id"]: body["parts"] for body in view["drawing"]["bodies"]}
    assert set(drawn) == {"object_1", "fixture:1"}
    assert [part["shape"] for part in drawn["fixture:1"]] == ["cylinder"]  # the floor
    assert set(view["poses"]) == {"object_1"}
    seen = json.dumps(view) + opening_prompt(session)
    assert not any(name in seen for name in ("hidden_", '"odo"', "salt", "responder", "wear"))
    assert not any(f"{value:.5g}" in seen for name, value in constants.items() if name != "m")
