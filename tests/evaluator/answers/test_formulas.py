"""Tests of formula answers: parsing, grading, and protection against malicious texts."""

import contextlib
import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from evaluator.answers import formula
from evaluator.answers.formula import parse_formula, points_of, value_of
from evaluator.answers.grading import grade
from evaluator.answers.strict import AnswerKey
from evaluator.records.episode import Verdict
from physment_mcp.contract.expressions import ExpressionError, Node
from scenes import AnswerKind, AnswerSpec
from scenes.answer_spec import Variable

VARIABLES = {
    "x": Variable(meaning="stretch", unit="m", range=(0.1, 2.0)),
    "m": Variable(meaning="mass", unit="kg", range=(1.0, 5.0)),
}


def key(text: str, rel_tol: float = 0.05) -> AnswerKey:
    return AnswerKey(text, AnswerSpec(kind=AnswerKind.FORMULA, unit="N", variables=VARIABLES, rel_tol=rel_tol))


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2 x", 4),
        ("2x^2", 8),
        ("-x^2", -4),
        ("2^-x", 0.25),
        ("x**2**3", 256),  # powers from right to left
        ("x - 1 - 1", 0),
        ("x / 2 * m", 3),
        ("3.2·x² − x", 10.8),
        ("x⁻¹", 0.5),
        ("√(m + 1)", 2),
        ("sin(pi / 2) + log(exp(x))", 3),
        ("2 (x + 1) m", 18),
        ("1e3 x", 2000),
        ("abs(-x) tanh(0) + ln(1)", 0),
        ("(((x)))", 2),
        ("+x", 2),
    ],
)
def test_a_formula_has_its_usual_value(text: str, value: float) -> None:
    assert value_of(parse_formula(text, VARIABLES), {"x": 2.0, "m": 3.0}) == pytest.approx(value)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "ends too early"),
        ("x +", "ends too early"),
        ("(x", "a bracket is not closed"),
        ("x)", "out of place"),
        ("F = 2 x", "has no meaning"),
        ("m g x", "'g' is no variable"),
        ("mx", "'mx' is no variable"),
        ("1/2 x", "above or below the division"),
        ("1/2(x + 1)", "above or below the division"),
        ("sin x", "write sin with brackets"),
        ("__import__('os').system('true')", "has no meaning"),
        ("x.real", "has no meaning"),
        ("lambda: x", "has no meaning"),
        ("(" * 200 + "x" + ")" * 200, "longer than 300 characters"),
        ("(" * 60 + "x" + ")" * 60, "nests more than 30 levels"),
        ("-" * 200 + "x", "nests more than 30 levels"),
        ("^x", "out of place"),
    ],
)
def test_what_is_no_formula_is_refused_with_its_reason(text: str, reason: str) -> None:
    with pytest.raises(ExpressionError, match=reason.replace("(", r"\(")):
        parse_formula(text, VARIABLES)


@pytest.mark.parametrize(
    "text", ["9**9**9", "9^9^9^9", "1/0", "log(0)", "sqrt(-1)", "(-8)^0.5", "1e308 * 1e308", "0^-1"]
)
def test_a_formula_without_a_finite_value_is_wrong_at_once(text: str) -> None:
    assert value_of(parse_formula(text, VARIABLES), {"x": 2.0, "m": 3.0}) is None
    found = grade(text, key("x"))
    assert found.strict is Verdict.INCORRECT
    assert "has no value" in found.reason


@given(st.text(alphabet="x1.e+-*/^() m²√sinlog=", max_size=60))
def test_any_text_is_read_or_refused(text: str) -> None:
    with contextlib.suppress(ExpressionError):
        value_of(parse_formula(text, VARIABLES), {"x": 2.0, "m": 3.0})


@pytest.mark.parametrize(
    ("answer", "is_right"),
    [
        ("3 x + m", True),
        ("m + x * 3", True),
        ("3.1 x + m", True),  # within 5 % everywhere
        ("3.6 x + m", False),
        ("3 x", False),
        ("3 x + m + 0.3 / (x - 1)", False),  # near the key, but not everywhere
        (3, False),
        (["3 x + m"], True),
        (["3 x", "m"], False),
        ("", False),
    ],
)
def test_a_formula_is_right_if_it_is_near_the_key_everywhere(answer: Any, is_right: bool) -> None:
    found = grade(answer, key("3*x + m", rel_tol=0.05))
    assert (found.normalised is Verdict.CORRECT) is is_right


def test_without_tolerance_only_rounding_is_allowed() -> None:
    exact = key("x^2 / m", rel_tol=0.0)
    assert grade("x*x*m^(-1)", exact).strict is Verdict.CORRECT
    assert grade("1.000001 x^2 / m", exact).strict is Verdict.INCORRECT


def test_the_points_cover_the_ranges_and_are_the_same_every_time() -> None:
    points = points_of(VARIABLES)
    assert points == points_of(VARIABLES)
    assert points[:2] == [{"x": 0.1, "m": 1.0}, {"x": 2.0, "m": 5.0}]
    assert all(
        variable.range[0] <= point[name] <= variable.range[1]
        for point in points
        for name, variable in VARIABLES.items()
    )


@pytest.mark.parametrize(
    ("text", "variables", "reason"),
    [
        ("3 q", VARIABLES, "no variable"),
        ("1/(x - 2)", VARIABLES, "has no value at x = 2"),
        ("x", {}, "needs variables"),
    ],
)
def test_a_key_that_cannot_be_compared_with_is_refused(text: str, variables: dict[str, Variable], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        AnswerKey(text, AnswerSpec(kind=AnswerKind.FORMULA, variables=variables))


def test_a_range_that_is_empty_is_refused() -> None:
    with pytest.raises(ValueError, match="is empty"):
        Variable(meaning="x", unit="m", range=(2.0, 2.0))


def test_algebra_says_where_a_formula_is_the_key_itself() -> None:
    pytest.importorskip("sympy")
    assert grade("x (3 x + 1)", key("3*x^2 + x")).reason == "the formula is the key, by algebra"
    assert grade("3 x^2 + x", key("3*x^2 + x")).reason == "the formula is the key, by algebra"
    assert "points" in grade("3.01 x^2 + x", key("3*x^2 + x")).reason


def test_algebra_knows_all_functions() -> None:
    pytest.importorskip("sympy")
    text = "sin(x) + cos(x) + tan(x) + asin(x) + acos(x) + atan(x) + tanh(x) + exp(-x) + log(x) - 2^x / sqrt(x)"
    first, second = (
        parse_formula(f"{text} + {rest}", {"x"}) for rest in ("abs(x) + ln(x) + pi", "pi + ln(x) + abs(x)")
    )
    assert formula.are_identical(first, second) is True


def test_algebra_that_takes_too_long_or_fails_says_nothing() -> None:
    pytest.importorskip("sympy")
    huge = parse_formula("0.5^(9^9) + x", {"x"})  # a fraction with hundreds of millions of digits
    assert formula.are_identical(huge, Node("name", text="x"), limit_s=2) is None
    assert formula.are_identical(Node("none_such", (Node("name", text="x"),)), Node("name", text="x")) is None


def test_without_sympy_the_verdict_is_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    def find_nothing(_name: str) -> None:
        return None

    monkeypatch.setattr(formula.importlib.util, "find_spec", find_nothing)
    found = grade("x (7 x + 1)", key("7*x^2 + x"))
    assert found.strict is Verdict.CORRECT
    assert "of the key at 66 points" in found.reason


def test_the_process_of_the_algebra_reads_trees_alone() -> None:
    """The child process gets a syntax tree, so it cannot run an agent's text."""
    tree = json.loads(json.dumps(parse_formula("2 x", {"x"})))
    assert tree == ["*", [["number", [], "2"], ["name", [], "x"]], ""]
