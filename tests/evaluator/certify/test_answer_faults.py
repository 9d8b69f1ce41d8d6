"""Tests of lint's rules on key, answer form and units, and of the errors of a run with a malformed key."""

from pathlib import Path
from typing import Any

import pytest

from evaluator.answers.grading import grade
from evaluator.answers.keys import KeyRing
from evaluator.certify.keys import answer_faults, check_constant
from evaluator.certify.lint import lint
from evaluator.certify.subject import Subject
from evaluator.commands.program import main
from evaluator.errors import UsageError
from evaluator.records.episode import Verdict
from physment_mcp.scene import load_scene
from physment_mcp.serving.prompts import opening_prompt
from physment_mcp.session import Session
from scenes import AnswerKind, Category, PackFiles, find_pack, list_packs, read_pack
from tests.builders.author import Author
from tests.builders.keys import FORMAT, STRICT, WRONG, verdict_of

OBSERVATIONS = (15, 57, 70)


@pytest.fixture
def files(author: Author) -> PackFiles:
    """A scene made from the template of Easy scenes, which asks for the mass of a cart in kg."""
    return author.write(Category.EASY_SINGLE)


def asking(author: Author, files: PackFiles, task: str, answer: Any, **spec: Any) -> list[str]:
    """Return the faults that lint finds in the scene with this question, key and answer form."""
    author.edit(files, lambda pack: pack["metadata"].update(task=task))
    author.edit(files, lambda pack: pack.update(answer=answer, answer_spec=spec))
    return lint(files)


TWO = "How fast is it, in m/s, and how high, in m?"
TWO_LABELS = {"kind": "numbers", "unit": ["m/s", "m"], "labels": ["speed", "height"]}


def test_a_pack_without_a_form_of_the_answer_has_no_faults_of_it(author: Author, files: PackFiles) -> None:
    author.edit(files, lambda pack: pack.pop("answer_spec"))
    assert list(answer_faults(read_pack(files))) == []
    assert "answer_spec is missing or empty" in lint(files)


@pytest.mark.parametrize(
    ("answer", "spec", "fault"),
    [
        ("about 8", {"kind": "number", "unit": "m"}, "the key 'about 8' is no number"),
        ([3.2, "x"], TWO_LABELS, "the key 'x' is no number"),
        ([3.2], TWO_LABELS, "needs one unit for each of its parts, not 2"),
        ([3.2], {**TWO_LABELS, "unit": ["m/s"]}, "needs one label for each of its parts, not 2"),
        (3.2, TWO_LABELS, "the key 3.2 is no list of numbers"),
        ([3.2, 1], {"kind": "number", "unit": "m/s"}, "is no number"),
        ([3.2, 1], {**TWO_LABELS, "labels": []}, "answer_spec.labels is empty"),
        ([3.2, 1], {**TWO_LABELS, "unit": "m/s"}, "answer_spec.unit is 'm/s': list one unit for each label"),
        ([3.2, 1], {**TWO_LABELS, "unit": "m/s and m"}, "'m/s and m' is no unit that can be read"),
        ("it stops", {"kind": "text"}, "make it a choice with options"),
        ("a, b", {"kind": "choice", "options": ["a, b", "c"]}, "none may have a comma"),
        ("a", {"kind": "choice", "options": ["b", "c"]}, "the answer 'a' is not among the options"),
        ("a", {"kind": "choice"}, "answer_spec.options is empty"),
        (3.2, {"kind": "number"}, "answer_spec.unit is missing"),
        (2, {"kind": "choice", "options": ["1", "2"], "accept": ["("]}, "the pattern '(' cannot be read"),
        ("q x", {"kind": "formula", "variables": {"x": {"meaning": "x", "unit": "m", "range": [1, 2]}}}, "'q' is no"),
    ],
)
def test_a_key_or_form_that_nothing_can_be_compared_with_is_a_fault(
    author: Author, files: PackFiles, answer: Any, spec: dict[str, Any], fault: str
) -> None:
    assert any(fault in sentence for sentence in asking(author, files, TWO, answer, **spec)), lint(files)


@pytest.mark.parametrize(
    ("task", "spec", "fault"),
    [
        (
            "Which force, in N, holds it?",
            {"kind": "number", "unit": "N·m"},
            "asks for N, but answer_spec.unit says N·m",
        ),
        ("Which work, in J, is done?", {"kind": "number", "unit": "N·m"}, "asks for J, but answer_spec.unit says N·m"),
        ("Which force holds it?", {"kind": "number", "unit": "N"}, "names no unit, but answer_spec.unit says N"),
        ("It is 2 m long. How long is it, in m?", {"kind": "number", "unit": "1"}, "asks for m, but answer_spec.unit"),
        ("Stated in N. Which force holds it?", {"kind": "number", "unit": "N"}, "names no unit"),
        (
            "How high is it, in m, and how fast, in m/s?",
            TWO_LABELS,
            "asks for m, m/s, but answer_spec.unit says m/s, m",
        ),
        ("How fast is it, in m/s, and how high?", TWO_LABELS, "asks for m/s, but answer_spec.unit says m/s, m"),
        (
            "Which side, in m, sinks?",
            {"kind": "choice", "options": ["3", "4"]},
            "asks for m, but answer_spec.unit says no",
        ),
    ],
)
def test_a_unit_of_the_question_that_is_not_that_of_the_answer_is_a_fault(
    author: Author, files: PackFiles, task: str, spec: dict[str, Any], fault: str
) -> None:
    answer = [3, 4] if spec["kind"] == "numbers" else 3
    assert any(fault in sentence for sentence in asking(author, files, task, answer, **spec)), lint(files)


@pytest.mark.parametrize(
    ("task", "spec"),
    [
        (TWO, TWO_LABELS),
        ("How fast is it, and how high? Answer with a list, in m/s and in m.", TWO_LABELS),
        ("How steep is it (in degrees)?", {"kind": "number", "unit": "degree"}),
        (
            "Pushed by 2 N times cos(10 t), with t in seconds, how far does it get, in m?",
            {"kind": "number", "unit": "m"},
        ),
        ("In which direction, in the end, does it go, in rad? (Its path is in m.)", {"kind": "number", "unit": "rad"}),
        ("What is its stiffness, in newtons per metre?", {"kind": "number", "unit": "N/m"}),
        ("By what factor is it faster?", {"kind": "number", "unit": "1"}),
        ("Which is faster?", {"kind": "choice", "options": ["3", "4"]}),
    ],
)
def test_a_question_in_the_units_of_its_answer_has_no_fault(
    author: Author, files: PackFiles, task: str, spec: dict[str, Any]
) -> None:
    assert asking(author, files, task, [3, 4] if spec["kind"] == "numbers" else 3, **spec) == []


@pytest.mark.parametrize("scene", [files.scene_id for files in list_packs()])
def test_every_scene_of_the_suite_asks_for_what_its_key_says(scene: int) -> None:
    assert list(answer_faults(read_pack(find_pack(scene)))) == []


@pytest.mark.parametrize("scene", [files.scene_id for files in list_packs()])
def test_every_number_of_the_suite_may_be_answered_with_its_unit(scene: int) -> None:
    key = KeyRing().key(scene, 0)
    if key.spec.kind not in {AnswerKind.NUMBER, AnswerKind.NUMBERS}:
        return
    units = key.spec.unit if isinstance(key.spec.unit, tuple) else (key.spec.unit,) * len(key.parts)
    answers = [str(part) if unit == "1" else f"{part} {unit}" for part, unit in zip(key.parts, units, strict=True)]
    plain = all(unit == "1" for unit in units)
    assert verdict_of([*answers] if isinstance(key.value, tuple) else answers[0], key) == (STRICT if plain else FORMAT)


@pytest.mark.parametrize("scene", OBSERVATIONS)
def test_an_observation_is_one_of_the_listed_options(scene: int) -> None:
    files = find_pack(scene)
    pack = read_pack(files)
    assert pack.metadata.problem_type == "observation"
    spec = pack.answer_spec
    assert spec is not None
    assert (spec.kind, len(spec.options)) == (AnswerKind.CHOICE, 3)
    assert f"Answer with exactly one of: {', '.join(spec.options)}." in opening_prompt(Session(load_scene(scene, 0)))
    constant = check_constant(Subject.open(files))
    assert constant.passed, constant.reasons
    keys = [KeyRing().key(scene, seed) for seed in range(20)]
    assert {key.value for key in keys} == set(spec.options)
    for key in keys:
        right = {option for option in spec.options if grade(option, key).strict is Verdict.CORRECT}
        assert right == {key.value}
        assert verdict_of(f"Answer: {key.value}.", key) == FORMAT


@pytest.mark.parametrize(
    "answer",
    [
        "both blocks lag behind",
        "the small block does not lag behind",
        "Lost energy below 2 %, so none; they part",
        "they stay together or they part",
        "energy",
        "it",
    ],
)
def test_words_that_are_no_option_are_wrong_whatever_the_key(answer: str) -> None:
    keys = [KeyRing().key(scene, seed) for scene in OBSERVATIONS for seed in range(8)]
    assert {verdict_of(answer, key) for key in keys} == {WRONG}


# Errors of a run whose key cannot be compared with any answer.
def test_a_run_of_a_pack_with_a_bad_key_is_refused_with_one_sentence(
    author: Author, files: PackFiles, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    author.edit(files, lambda pack: pack.update(answer="about 8"))
    words = ["run", "--agent", "reference", "--scenes-dir", str(author.folder), "--scenes", str(files.scene_id)]
    assert main([*words, "--out", str(tmp_path / "run")]) == 2
    said = capsys.readouterr().err.strip()
    assert len(said.splitlines()) == 1
    assert "no answer can be compared with its key at seed 0: the key 'about 8' is no number" in said


def test_grading_again_with_a_bad_key_is_refused_with_one_sentence(
    author: Author, files: PackFiles, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """At seeds other than 0 the key comes from `theory`, which lint does not run."""
    words = ["run", "--agent", "reference", "--scenes-dir", str(author.folder), "--scenes", str(files.scene_id)]
    folder = tmp_path / "run"
    assert main([*words, "--seeds", "3", "--out", str(folder)]) == 0
    capsys.readouterr()
    author.replace(files.solution, 'return knobs["m"]', 'return "about 8"')
    assert main(["grade", str(folder), "--scenes-dir", str(author.folder), "--allow-other-packs"]) == 2
    said = capsys.readouterr().err.strip()
    assert len(said.splitlines()) == 1
    assert "the key 'about 8' is no number" in said


def test_the_key_of_a_seed_that_is_no_number_is_refused(author: Author, files: PackFiles) -> None:
    author.replace(files.solution, 'return knobs["m"]', 'return [knobs["m"], "x"]')
    with pytest.raises(UsageError, match="no answer can be compared with its key at seed 3"):
        KeyRing(author.folder).key(files.scene_id, 3)
