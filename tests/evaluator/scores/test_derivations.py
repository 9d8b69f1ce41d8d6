"""Tests of numbers derived by arithmetic in the text, and of formula coefficients: each case counted by hand."""

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from evaluator.quantities.formulas import formulas_in
from evaluator.scores.grounding import Grounding, grounding_of
from physment_mcp.serving.examples import EXAMPLES, PromptExample
from tests.builders.records import episode, returned, turn

VELOCITY = returned("get_velocity", {"sim_time": 0.5, "velocity": [3.2, 0.0, -4.905]}, object_id="object_1")


def after(reasoning: str, prompt: str = "") -> Grounding:
    """Return the grounding of a turn's reasoning, after a turn that read `VELOCITY` and 0.5 s."""
    step = returned("step", {"sim_time": 0.5}, duration=0.5)
    return grounding_of(episode(turn("", step, VELOCITY), turn(reasoning), prompt=prompt))


def derived(grounding: Grounding) -> list[str]:
    return [said.text for said in grounding.assertions if said.derivation is not None]


def baseless(grounding: Grounding) -> list[str]:
    return [said.text for said in grounding.assertions if said.derivation is None and said.support is None]


@pytest.mark.parametrize(
    ("said", "result"),
    [
        ("a = 4.905 / 0.5 = 9.81 m/s² downward", "9.81 m/s²"),
        ("E = v² / 2 = 3.2² / 2 = 5.12", "5.12"),
        ("The speed is √(3.2² + 4.905²) = 5.857 m/s.", "5.857 m/s"),
        (r"\(v = \sqrt{3.2^2 + (-4.905)^2} \approx 5.86\)", "5.86"),
        (r"so $\frac{3.2}{0.5} = 6.4$", "6.4"),
        ("3.2 m/s * 0.5 s = 1.6 m", "1.6 m"),
        ("3.2 m/s · 0.5 s = 160 cm", "160 cm"),
        ("3.2 - 0.5 = 2.7", "2.7"),
        ("**x = 3.2 × 0.5 = 1.6**", "1.6"),
        ("the angle is arctan(3.2/4.905) = 33.1° below", "33.1°"),
        ("T = 2π·3.2 = 20.11", "20.11"),
        ("KE = ½ m v² = ½ · 0.5 · 3.2² = 2.56", "2.56"),
        ("p = m v = 0.5·3.2 = 1.600 kg·m/s", "1.600 kg·m/s"),
        ("3.2e0 * 5e-1 = 1.6", "1.6"),
    ],
)
def test_a_number_that_follows_from_known_ones_is_derived(said: str, result: str) -> None:
    found = after(said, prompt="The mass is 0.5 kg.")
    assert result in derived(found)
    assert found.share_with_derived == 1
    assert found.share is not None
    assert found.share < 1


@pytest.mark.parametrize(
    "said",
    [
        "a = 4.905 / 0.5 = 9.91 m/s² downward",
        "E = 3.2² = 10.3",
        "3.2 * 7.7 = 24.64",
        "3.2 m/s * 0.5 s = 1.6 cm",
        "3.2 × 0.5 is 1.6",
        "x = v t = 1.6",
        "q = 3 k / 4 = 3 / 4 = 0.75",
        "-4.905 / 0.5 = 9.81",
        "3.2 / 0 = 1.6",
        "9**9**9**9 * 3.2 = 1.6",
        "(" * 200 + "3.2 * 0.5" + ")" * 200 + " = 1.6",
    ],
    ids=[
        "wrong",
        "rounded wrongly",
        "unknown",
        "unit",
        "no equals sign",
        "symbols",
        "constants",
        "sign",
        "zero",
        "huge",
        "deep",
    ],
)
def test_arithmetic_that_is_wrong_or_unfounded_derives_nothing(said: str) -> None:
    assert derived(after(said)) == []


def test_a_result_computed_from_unrounded_readings_is_derived() -> None:
    # 4.905 is written as 4.9; 4.9 / 0.5 would be 9.80.
    assert derived(after("a = 4.9 / 0.5 = 9.81 m/s² downward")) == ["9.81 m/s²"]


def test_a_derived_number_founds_later_ones_also_in_later_turns() -> None:
    step = returned("step", {"sim_time": 0.5}, duration=0.5)
    found = grounding_of(
        episode(
            turn("", step, VELOCITY),
            turn("F/m: 3.2 / 0.5 = 6.4 m/s², then 6.4 * 0.5 = 3.20 and 6.4 · 3.2 = 20.48."),
            turn("With 6.4 m/s² and 20.48, 20.48 / 3.2 = 6.40."),
        )
    )
    assert baseless(found) == []
    assert found.share_with_derived == 1


@pytest.mark.parametrize(
    "said",
    [
        *("ω = 2 E / L", "h = v² / 2g", "E = m v^2 / 2", "T = 2 π √(L / g)", "K = 0.5 m v²", "1 - cos θ", "x = ½ a t²"),
        *(r"\(I = 2 m r^2 / 5\)", "F = 6 π η r v", "r = (m1 + 2 m2) / 3"),
    ],
)
def test_coefficients_of_symbols_are_no_assertions(said: str) -> None:
    assert after(said).assertions == ()


@pytest.mark.parametrize(
    ("said", "numbers"),
    [
        ("a 3 kg block and I push with 5 N", ["3 kg", "5 N"]),
        ("v = 9.9 t", ["9.9 t"]),
        ("m = 2 kg", ["2 kg"]),
        ("x = -8", ["-8"]),
        ("g = 9.9 m/s² and 12.5 x", ["9.9 m/s²", "12.5"]),
    ],
)
def test_numbers_that_measure_stay_assertions_beside_symbols(said: str, numbers: list[str]) -> None:
    assert [found.text for found in after(said).assertions] == numbers


@pytest.mark.parametrize(
    "said",
    ["it drops at 4.905 m/s", "4.905 m/s backwards", "4.905 m/s in the negative direction", "falling with 4.905 m/s"],
)
def test_a_sign_may_be_told_in_words(said: str) -> None:
    assert after(said).share == 1


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.title)
def test_our_worked_examples_are_grounded(example: PromptExample) -> None:
    turns = [
        turn(
            said.reasoning,
            *(returned(call.tool, json.loads(call.returned or "{}"), **call.arguments) for call in said.calls),
        )
        for said in example.turns
    ]
    found = grounding_of(episode(*turns, prompt=example.task))
    assert found.assertions
    assert found.share_with_derived is not None
    assert found.share_with_derived >= 0.9


@settings(max_examples=200)
@given(st.text(alphabet="0123456789.+-*/^()=≈√π½²xvg \\{}$·m s,e", max_size=80))
def test_any_text_is_searched_for_formulas(text: str) -> None:
    found = formulas_in(text)
    assert all(text[at].isdigit() or text[at] == "." for at in found.coefficients)
    for statement in found.statements:
        assert statement.outcome({}, in_si=True) == statement.outcome({}, in_si=True)


@given(st.floats(0.1, 100), st.floats(0.1, 100))
def test_a_right_quotient_is_derived_and_a_wrong_one_is_not(a: float, b: float) -> None:
    written_a, written_b = f"{a:.3f}", f"{b:.3f}"
    value = float(written_a) / float(written_b)
    reading = returned("read", {"a": float(written_a), "b": float(written_b)})
    for stated, is_right in ((f"{value:.4f}", True), (f"{1.01 * value + 0.02:.4f}", False)):
        said = grounding_of(episode(turn("", reading), turn(f"q = {written_a} / {written_b} = {stated}")))
        result = said.assertions[-1]
        if result.support is None:
            assert (result.derivation is not None) == is_right
