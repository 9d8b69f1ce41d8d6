"""Tests of laws that agents state: their accelerations and length, and malformed laws, refused with one sentence."""

import gc
import json
import math
import weakref
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from jsonschema import Draft202012Validator

from physment_mcp.contract.expressions import ExpressionError
from physment_mcp.contract.stated_laws import MAX_CHARS, MAX_LENGTH, MAX_LET, MAX_STATES, SCHEMA, StatedLaw

OBJECTS = ["object_1", "object_2"]
LAW: dict[str, Any] = {
    "acceleration": {
        "object_1": {"x": "object_1_push_x/m - c*object_1_vx + 0*object_2_x", "y": -2},
        "object_2": {"angle": "object_2_turn_z - way"},
    },
    "let": {"m": 2, "c": "0.5*exp(-way/3)"},
    "state": {"way": {"start": 1.5, "rate": "hypot(object_1_vx, object_1_vy)"}},
}


def x(text: object, **more: object) -> dict[str, Any]:
    return {"acceleration": {"object_1": {"x": text}}, **more}


def refusal(law: object) -> str:
    with pytest.raises(ExpressionError) as refused:
        StatedLaw(law, OBJECTS)
    return str(refused.value)


def test_a_law_gives_the_stated_accelerations_and_then_the_rates_of_its_states() -> None:
    law = StatedLaw(LAW, OBJECTS)
    assert law.components == [("object_1", "x"), ("object_1", "y"), ("object_2", "angle")]
    values = dict.fromkeys(law.arguments, 0.0) | {
        "object_1_push_x": 3.0, "object_1_vx": 3.0, "object_1_vy": 4.0, "object_2_turn_z": 7.0, "way": 1.5,
    }  # fmt: skip
    x_axis, y_axis, angle, rate = law.rates(*values.values())
    assert x_axis == pytest.approx(1.5 - 1.5 * math.exp(-0.5))
    assert (y_axis, angle, rate) == (-2, 5.5, 5)
    assert law.states == {"way": 1.5}
    assert {"way", "object_1_vx", "object_1_push_x"} < law.used


def test_the_length_counts_names_numbers_operators_and_functions() -> None:
    assert StatedLaw(x("a*2", let={"a": "object_1_vx"}), OBJECTS).length == 4
    assert StatedLaw(x("sqrt(1)"), OBJECTS).length == 2


def test_the_schema_accepts_every_form_that_the_reader_accepts() -> None:
    validator = Draft202012Validator(dict(SCHEMA))
    assert validator.is_valid(LAW)
    for bad in ({}, {"acceleration": {}}, {**LAW, "more": 1}, x(True), x("1", state={"s": {"rate": "1"}})):
        assert not validator.is_valid(bad)
        assert refusal(bad)


@pytest.mark.parametrize(
    ("law", "sentence"),
    [
        (None, "law must be an object with the fields acceleration, let, state"),
        ("-k*x", "law must be an object"),
        ([LAW], "law must be an object"),
        ({}, "acceleration must be an object"),
        ({"acceleration": {"object_1": {}}}, "acceleration: state one at least"),
        ({"acceleration": {"1": {"x": "1"}}}, "there is no object '1'; name object_1, object_2"),
        ({"acceleration": {"gate": {"x": "1"}}}, "there is no object 'gate'; name object_1, object_2"),
        ({"acceleration": {"object_1": {"vx": "1"}}}, "has no field 'vx'; its fields are x, y, z, angle"),
        (x(""), "must be an expression"),
        (x(True), "must be an expression"),
        (x(None), "must be an expression"),
        (x(10**400), "must be an expression"),
        (x("gate_z"), "the name 'gate_z' is unknown here"),
        (x("object_3_x"), "the name 'object_3_x' is unknown here"),
        (x("later", let={"later": "after", "after": "1"}), "let.later: the name 'after' is unknown here"),
        (x("f(1)"), "there is no function 'f'"),
        (x("(1"), "a bracket is not closed"),
        (x("1 +"), "it ends too early"),
        (x("2 object_1_vx"), "is out of place"),
        (x("object_1_vx = 2"), "'=' has no meaning here"),
        (x("__import__('os')"), "has no meaning here"),
        (x("().__class__"), "has no meaning here"),
        (x("lambda: 1"), "has no meaning here"),
        (x("1e999"), "a number in it is too large"),
        (x("(" * 40 + "1" + ")" * 40), "it nests more than 30 levels"),
        (x("-" * 500 + "1"), "it nests more than 30 levels"),
        (x("+".join(["1"] * 600)), "at most 1000 are allowed"),
        (x("1", let={f"a{n}": "1" * 150 for n in range(MAX_LET)}), f"at most {MAX_CHARS} are allowed in all"),
        (x("1", let={f"a{n}": "1" for n in range(MAX_LET + 1)}), "let has at most 40 names"),
        (x("1", state={f"a{n}": {"start": 0, "rate": 1} for n in range(MAX_STATES + 1)}), "state at most 16"),
        (x("1", let={"object_1_x": "1"}), "the name 'object_1_x' has a meaning already"),
        (x("1", let={"sin": "1"}), "the name 'sin' has a meaning already"),
        (x("1", let={"a b": "1"}), "'a b' cannot be a name"),
        (x("1", let={"\ud800": "("}), "let: '\\ud800' cannot be a name"),
        (x("1", state={"\ud800": 1}), "state.\\ud800 must be an object"),
        (x("1", state={"t": {"start": 0, "rate": 1}}), "the name 't' has a meaning already"),
        (x("1", state={"s": {"start": "0", "rate": 1}}), "state.s.start must be a number"),
        (x("1", state={"s": {"start": math.nan, "rate": 1}}), "state.s.start must be a number"),
        (x("1", state={"s": {"start": 0}}), "state.s.rate must be an expression"),
        (x("1", state={"s": {"start": 0, "rate": "1/0"}}), "state.s.rate: division by zero"),
        (x("9**9**9"), "a number becomes too large"),
        (x("exp(exp(exp(t)))"), "a number becomes too large"),
        (x("1/0"), "division by zero"),
        (x("object_1_vx**1.5"), "a function or a power is not defined for its arguments, at object_1_vx = -"),
        (x("sqrt(-1)"), "is not defined"),
        (x("1e300*1e300"), "the value is inf"),
    ],
)
def test_a_bad_law_is_refused_with_one_sentence(law: object, sentence: str) -> None:
    found = refusal(law)
    assert sentence in found
    assert "\n" not in found
    assert len(found) < 400


def test_powers_of_powers_are_never_computed_as_integers() -> None:
    """Python would compute the 370 million digits of 9**9**9 for hours; a law uses only floating-point numbers."""
    costly = x("a39", let={"a0": "2", **{f"a{n}": f"a{n - 1}**a{n - 1}" for n in range(1, 40)}})
    nested = x("hypot(" + ",".join(["9**9**9"] * 20) + ")")
    for law in (costly, nested):
        assert refusal(law).endswith("a number becomes too large, at any state")


def test_a_wide_law_within_the_limit_of_operations_is_compiled() -> None:
    lengths = [StatedLaw(x(sign.join([name] * 499)), OBJECTS).length for sign, name in (("%", "9"), ("<", "t"))]
    assert lengths == [997, 500]


def test_a_law_of_too_many_operations_is_refused() -> None:
    let = {f"a{n}": "+".join(["t"] * 100) for n in range(4)}  # 199 names and operators each
    longest = x("a0 + a1 + a2 + a3", let={**let, "a4": "+".join(["t"] * 99)})
    assert StatedLaw(longest, OBJECTS).length == MAX_LENGTH
    longer = {**longest, "let": {**longest["let"], "a4": "+".join(["t"] * 100)}}
    sentence = "it has 1002 names, numbers, operators and functions; at most 1000 are allowed in all"
    assert refusal(longer) == sentence


def test_the_code_of_a_law_of_an_agent_is_not_kept() -> None:
    law = StatedLaw(x("sin(t)"), OBJECTS)
    code = weakref.ref(law.rates.__code__)
    del law
    gc.collect()
    assert code() is None


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=30),
    lambda part: st.lists(part, max_size=3) | st.dictionaries(st.text(max_size=10), part, max_size=3),
    max_leaves=8,
)


@given(st.dictionaries(st.sampled_from(["acceleration", "let", "state"]), JSON) | JSON)
def test_any_json_is_a_law_or_refused(law: object) -> None:
    try:
        StatedLaw(law, OBJECTS)
    except ExpressionError as error:
        said = str(error)
    else:
        said = "it is a law"
    assert said


def test_names_of_a_law_may_be_those_of_json_texts() -> None:
    assert StatedLaw(json.loads(json.dumps(LAW)), OBJECTS).length == StatedLaw(LAW, OBJECTS).length
