"""Tests of lint and certificates for scenes that ask for a formula or name intermediate quantities."""

import pytest

from evaluator.answers.grading import grade_episode
from evaluator.answers.keys import KeyRing
from evaluator.certify.lint import lint
from evaluator.certify.records import SceneCertificate
from evaluator.certify.subject import Subject
from evaluator.certify.verify import MemoryConnector, certify, play_reference
from evaluator.records.episode import Verdict
from physment_mcp.scene import load_scene
from physment_mcp.serving.prompts import opening_prompt
from physment_mcp.session import Session
from scenes import Category, PackFiles
from tests.builders.author import Author

SEEDS = 3
ANSWER = 'yield [answer(FORCE_N * PUSH_S / readings[-1]["velocity"][0])]'
FORMULA = {
    "kind": "formula",
    "unit": "m/s²",
    "variables": {"F": {"meaning": "force along x", "unit": "N", "range": [1, 20]}},
}


@pytest.fixture
def files(author: Author) -> PackFiles:
    """A scene made from the template of Easy scenes, which asks for the mass of a cart."""
    return author.write(Category.EASY_SINGLE)


@pytest.fixture
def formula(author: Author, files: PackFiles) -> PackFiles:
    """A scene whose answer is a formula: the acceleration of a cart as a function of the force."""
    author.edit(files, lambda pack: pack.update(answer="F / 2", answer_spec=FORMULA))
    author.replace(files.json, "What is its mass, in kg?", "What is its acceleration under a force, in m/s\\u00b2?")
    author.replace(
        files.solution, ANSWER, "yield [answer(f\"F * {readings[-1]['velocity'][0] / (FORCE_N * PUSH_S)}\")]"
    )
    author.replace(files.solution, 'return knobs["m"]', "return f\"F / {knobs['m']}\"")
    author.replace(files.solution, "return float(FORCE_N * PUSH_S /", 'return "F / %.9g" % (FORCE_N * PUSH_S /')
    return files


async def proven(files: PackFiles) -> SceneCertificate:
    return await certify(files, SEEDS, MemoryConnector(files.folder.parent))


def reasons(certificate: SceneCertificate) -> str:
    return "; ".join(reason for check in certificate.checks for reason in check.reasons)


async def test_a_scene_that_asks_for_a_formula_is_sound(formula: PackFiles) -> None:
    assert reasons(await proven(formula)) == ""
    subject, memory = Subject.open(formula), MemoryConnector(formula.folder.parent)
    for seed in range(SEEDS):
        played = await play_reference(subject, seed, memory)
        key = KeyRing(formula.folder.parent).key(formula.scene_id, seed)
        assert grade_episode(played, key).strict is Verdict.CORRECT
    prompt = opening_prompt(Session(load_scene(formula.scene_id, 0, formula.folder.parent)))
    assert "Answer with a formula (in m/s²) in these variables: F, force along x (in N), from 1 to 20." in prompt


async def test_a_wrong_formula_fails_the_key(author: Author, formula: PackFiles) -> None:
    author.replace(formula.solution, "return f\"F / {knobs['m']}\"", "return f\"F / {1.2 * knobs['m']}\"")
    assert "theory gives F / " in reasons(await proven(formula))


def test_a_formula_without_variables_is_a_fault(author: Author, files: PackFiles) -> None:
    author.edit(files, lambda pack: pack.update(answer="F / 2", answer_spec={"kind": "formula", "unit": "m/s²"}))
    assert "answer_spec.variables is empty: a formula needs the variables that it may use" in lint(files)


STEPS = {"gained": {"meaning": "speed after a push of 4 N s", "unit": "m/s", "value": "4 / m"}}


async def test_the_reference_must_state_every_step_rightly(author: Author, files: PackFiles) -> None:
    author.edit(files, lambda pack: pack.update(steps=STEPS))
    assert "the reference states None for gained, which is" in reasons(await proven(files))
    author.replace(files.solution, ANSWER, ANSWER.replace(")]", ', gained=1.2 * readings[-1]["velocity"][0])]'))
    assert "for gained, which is 2" in reasons(await proven(files))
    author.replace(files.solution, "gained=1.2 * ", "gained=")
    assert reasons(await proven(files)) == ""


def test_a_step_that_cannot_be_computed_is_a_fault(author: Author, files: PackFiles) -> None:
    steps = {"gained": {**STEPS["gained"], "value": "4 / none_such"}}
    author.edit(files, lambda pack: pack.update(steps=steps))
    assert any("steps.gained" in sentence for sentence in lint(files))


def test_the_prompt_names_steps_and_tells_no_value(author: Author, files: PackFiles) -> None:
    author.edit(files, lambda pack: pack.update(steps=STEPS))
    session = Session(load_scene(files.scene_id, 0, files.folder.parent))
    prompt = opening_prompt(session)
    assert "- `gained`: speed after a push of 4 N s (in m/s)." in prompt
    assert "4 / m" not in prompt
    session.answer(2.0, {"gained": 2.0})
    assert session.state.steps == {"gained": 2.0}
