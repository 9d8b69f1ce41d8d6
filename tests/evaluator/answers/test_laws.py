"""Tests of the grading of laws that agents write: which laws count as equivalent, whatever their notation."""

import copy
import itertools
import json
from typing import Any

import pytest

from evaluator.answers.keys import KeyRing
from evaluator.answers.law_motion import StatedMotion
from evaluator.answers.laws import MAX_WORK, TrueLaw, evaluations_of, grade_law, stated_law
from evaluator.records.episode import LawGrade, Outcome
from physment_mcp.contract.stated_laws import MAX_LENGTH
from scenes import one_world
from tests.builders.records import episode, refused, returned, turn

RING = KeyRing()
TRUE = RING.law(201, 1)
assert TRUE is not None
STATEMENT: dict[str, Any] = json.loads(json.dumps(TRUE.model.statement))


def graded(law: object, true: TrueLaw = TRUE) -> LawGrade:
    return grade_law(law, true)


def changed(**let: str) -> dict[str, Any]:
    """Return the true law with some auxiliary quantities (`let`) replaced."""
    law = copy.deepcopy(STATEMENT)
    law["let"] |= let
    return law


def test_the_true_law_is_known() -> None:
    found = graded(STATEMENT)
    assert (found.equivalent, found.error_within, found.error_beyond, found.dependence_f1) == (True, 0, 0, 1)
    assert (found.length, found.refused) == (57, "")


def test_a_law_that_is_written_otherwise_gets_the_same_grade() -> None:
    law = copy.deepcopy(STATEMENT)
    law["let"]["speed"] = "hypot(object_1_vx, object_1_vy) + 0*t + 0*sin(object_1_x)"
    law["state"] = {"unused": {"start": 1, "rate": "object_1_vx"}}
    found = graded(law)
    assert found.equivalent
    assert found.error_beyond == pytest.approx(0, abs=1e-4)
    assert found.dependence_f1 == 1
    assert found.length > 57


def test_a_law_without_the_force_across_is_neither_equivalent_nor_free_of_missed_dependences() -> None:
    found = graded(changed(turn="0"))
    assert not found.equivalent
    assert found.error_within is not None
    assert found.error_within > 0.1
    assert 0.5 < found.dependence_f1 < 1


def test_a_law_that_holds_only_within_the_laboratory_is_not_known() -> None:
    inside = "1 if hypot(object_1_x, object_1_y) < 6 else 0.2"
    found = graded(changed(g=f"({STATEMENT['let']['g']})*({inside})"))
    assert found.error_within is not None
    assert found.error_within < 0.01
    assert found.error_beyond is not None
    assert found.error_beyond > 0.05
    assert not found.equivalent


def test_dependences_that_the_law_does_not_have_lower_the_score() -> None:
    law = copy.deepcopy(STATEMENT)
    for axis in "xy":
        law["acceleration"]["object_1"][axis] += " + 0.3*sin(t) + 0.2*object_1_y"
    assert graded(law).dependence_f1 < 0.95


def test_a_component_that_is_left_out_is_zero() -> None:
    law = {"acceleration": {"object_1": {"x": STATEMENT["acceleration"]["object_1"]["x"]}}, "let": STATEMENT["let"]}
    assert graded(law) != graded(STATEMENT)
    assert not graded(law).equivalent


@pytest.mark.parametrize(
    "text",
    [
        "exp(object_1_vx**2 + object_1_vy**2)*object_1_vx",
        "1e6*object_1_vx",
        "log(5 - abs(object_1_x))",
    ],
)
def test_a_law_that_diverges_has_no_error_and_is_not_known(text: str) -> None:
    found = graded({"acceleration": {"object_1": {"x": text, "y": text.replace("vx", "vy")}}})
    assert (found.equivalent, found.error_beyond) == (False, None)
    json.dumps(found.model_dump(), allow_nan=False)


@pytest.mark.parametrize("text", ["1e200", "1e308*sign(object_1_x)", "state"])
def test_a_law_of_enormous_values_is_graded(text: str) -> None:
    law = {"acceleration": {"object_1": {"x": text}}, "state": {"state": {"start": 1e299, "rate": "state"}}}
    found = graded(law)
    assert not found.equivalent
    json.dumps(found.model_dump(), allow_nan=False)


def test_a_law_whose_grading_would_take_too_long_is_refused_in_one_sentence() -> None:
    assert TRUE is not None
    slow = TRUE._replace(lab_time=3600.0)
    states = {"way": {"start": 0, "rate": "+".join(["t"] * 100)}}
    law = {"acceleration": {"object_1": {"x": "way"}}, "state": states}
    assert graded(law).refused == ""
    millions = round(200 * evaluations_of(slow, has_states=True) / 1e6)
    sentence = f"it cannot be compared: that takes {millions} million operations, and at most 400 million are made"
    assert graded(law, slow).refused == sentence
    assert graded({"acceleration": {"object_1": {"x": "+".join(["t"] * 100)}}}, slow).refused == ""


@pytest.mark.parametrize("scene", [201, 202, 205])
def test_no_law_that_the_laboratory_accepts_takes_too_long_in_the_suite(scene: int) -> None:
    true = RING.law(scene, 1)
    assert true is not None
    assert MAX_LENGTH * evaluations_of(true, has_states=True) <= MAX_WORK


@pytest.mark.parametrize("scene", [201, 203])
def test_the_number_of_evaluations_is_known_before(scene: int, monkeypatch: pytest.MonkeyPatch) -> None:
    true, made, rates = RING.law(scene, 1), itertools.count(), StatedMotion.rates
    assert true is not None

    def counting(law: StatedMotion, *now: Any) -> tuple[list[float], list[float]]:
        next(made)
        return rates(law, *now)

    monkeypatch.setattr(StatedMotion, "rates", counting)
    graded(true.model.statement, true)
    known = evaluations_of(true, has_states="state" in true.model.statement)
    assert 0.7 * known <= next(made) / 2 <= known  # half of them are of the true law


@pytest.mark.parametrize("law", ["x", {}, {"acceleration": {"object_1": {"x": "nonsense"}}}, [1], 3.5])
def test_a_law_of_an_edited_record_that_cannot_be_read_is_graded_as_such(law: object) -> None:
    found = graded(law)
    assert not found.equivalent
    assert found.refused


def test_a_law_without_an_effect_that_few_courses_meet_is_not_known() -> None:
    true = RING.law(202, 1)
    assert true is not None
    law = json.loads(json.dumps(true.model.statement))
    name = next(iter(law["state"]))
    law["state"][name]["rate"] = "0"
    found = graded(law, true)
    assert found.error_within is not None
    assert found.error_within < 0.01
    assert found.dependence_f1 < 1
    assert not found.equivalent


def test_a_wrong_memory_is_found_out() -> None:
    true = RING.law(203, 1)
    assert true is not None
    law = json.loads(json.dumps(true.model.statement))
    assert graded(law, true).equivalent
    for name in ("past_vx", "past_vy"):
        law["state"][name]["rate"] = "0"
    found = graded(law, true)
    assert not found.equivalent
    assert found.dependence_f1 < 1


def test_a_hidden_body_may_be_stated_by_other_states() -> None:
    """A state variable of scene 203 is scaled by two and its effect halved, which is equivalent."""
    true = RING.law(203, 1)
    assert true is not None
    law = json.loads(json.dumps(true.model.statement))
    renamed = json.loads(json.dumps(law).replace("past_vx", "(lagx/2)").replace("past_vy", "(lagy/2)"))
    renamed["state"] = {
        name: {"start": 0, "rate": f"2*({law['state'][old]['rate'].replace(old, f'({name}/2)')})"}
        for name, old in (("lagx", "past_vx"), ("lagy", "past_vy"))
    }
    found = graded(renamed, true)
    assert found.equivalent
    assert found.dependence_f1 == 1


@pytest.mark.parametrize(
    "reference",
    [
        "world:1:0",
        "world:3:1",
        *(pytest.param(name, marks=pytest.mark.extended) for name in ("world:6:1", "world:7:0")),
    ],
)
def test_laws_of_worlds_are_graded(reference: str) -> None:
    true = RING.law(one_world(reference), 0)
    assert true is not None
    assert graded(true.model.statement, true).equivalent
    other = {
        "acceleration": {
            body: {axis: f"{body}_{'turn_z' if axis == 'angle' else f'push_{axis}'}" for axis in true_axes(true, body)}
            for body in true.objects
        }
    }
    assert not graded(other, true).equivalent


def true_axes(true: TrueLaw, body: str) -> list[str]:
    return [axis for name, axis, _ in true.model.coordinates if name == body]


def test_the_law_of_an_episode_is_that_of_its_accepted_answer() -> None:
    first, second = refused("answer", answer=1, law={"no": 1}), returned("answer", None, answer=1, law=STATEMENT)
    played = episode(turn("", first), turn("", second))
    assert stated_law(played) == STATEMENT
    assert stated_law(played.model_copy(update={"outcome": Outcome.BUDGET_EXHAUSTED})) is None
    assert stated_law(played.model_copy(update={"turns": (turn("", returned("answer", None, answer=1)),)})) is None
