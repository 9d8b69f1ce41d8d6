"""Tests of expressions of laws: their values, and everything that they may not contain."""

import contextlib
import gc
import math
import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from physment_mcp.contract.expressions import ExpressionError
from physment_mcp.contract.formulas import Formulas


def value(text: str, **names: float) -> float:
    (result,) = Formulas(list(names), {}, {}, {"f": text}).function(list(names))(*names.values())
    return result


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("1 + 2*3 - 4/8", 6.5),
        ("-2**2", -4.0),
        ("2**-1", 0.5),
        ("7 % 4", 3.0),
        ("-7 % 4", 1.0),
        ("x if x > 3 and not x == 5 else -x", 4.0),
        ("1 < x <= 4 or 1/0", 1.0),
        ("(x > 3)*2", 2.0),
        ("min(x, 2, 7) + max(x, 2)", 6.0),
        ("abs(-x) + sqrt(x) + hypot(3, x)", 11.0),
        ("exp(0) + log(exp(2)) + tanh(0)", 3.0),
        ("sin(pi/2) + cos(pi) + tan(0)", 0.0),
        ("asin(1) + acos(0) + atan(1) + atan2(-1, 0)", 0.75 * math.pi),
        ("sign(-x) + sign(0) + floor(-0.5)", -2.0),
    ],
)
def test_an_expression_has_the_value_of_arithmetic(text: str, expected: float) -> None:
    assert value(text, x=4.0) == pytest.approx(expected)


@pytest.mark.parametrize("text", ["x > 3", "not x", "(x > 3) + (x > 3)", "-(x > 3)", "x > 3 or x", "max(x > 3, 0)"])
def test_truth_values_are_floats(text: str) -> None:
    assert type(value(text, x=4.0)) is float


def test_products_of_truth_values_build_no_huge_integer() -> None:
    """Each product has twice as many digits as the one before, unless it is a float."""
    let = {"a0": "(x > 3) + (x > 3)"} | {f"a{n}": f"a{n - 1}*a{n - 1}" for n in range(1, 15)}
    (found,) = Formulas(["x"], {}, let, {"f": "a14"}).function(["x"])(4.0)
    assert found == math.inf


@given(
    st.floats(-50, 50).filter(lambda number: abs(number) > 1e-3),
    st.floats(0.01, 9),
    st.floats(-3, 3),
)
def test_a_law_of_forces_has_the_value_that_python_computes(x: float, y: float, p: float) -> None:
    expected = (x * y - p) / x + y**p if x > p else math.atan2(y, x) % 2.0
    assert value("(x*y - p)/x + y**p if x > p else atan2(y, x) % 2", x=x, y=y, p=p) == expected


def test_later_quantities_use_the_earlier_ones_and_constants_are_fixed() -> None:
    formulas = Formulas(["x", "y"], {"k": 2.0}, {"r": "k*x", "s": "r + k"}, {"f": "s*r", "g": "s"})
    assert formulas.function(["x"])(3.0) == (48.0, 8.0)
    assert formulas.used == {"x"}


def test_the_first_field_without_a_finite_value_is_named() -> None:
    formulas = Formulas(["x"], {}, {"r": "1/x", "s": "log(x)"}, {"f": "0", "g": "exp(x)"})
    assert formulas.fault(["x"], [1.0]) is None
    assert formulas.fault(["x"], [0.0]) == "let.r: division by zero"
    assert formulas.fault(["x"], [-1.0]) == "let.s: a function or a power is not defined for its arguments"
    assert formulas.fault(["x"], [1000.0]) == "g: a number becomes too large"


@pytest.mark.parametrize(
    "text",
    [
        "",
        "x +",
        "x; x",
        "x = 1",
        "x\nx",
        "import os",
        "x.real",
        "x.__class__",
        "__import__('os')",
        "__builtins__",
        "x[0]",
        "[x][0]",
        "(x, x)",
        "{x}",
        "{x: x}",
        "lambda: x",
        "(lambda: x)()",
        "[x for x in (1, 2)]",
        "sum(x for _ in (1,))",
        "(y := x)",
        "'x'",
        "b'x'",
        "f'{x}'",
        "None",
        "True",
        "...",
        "1j",
        "1e999",
        "9" * 400,
        "x // 2",
        "x @ x",
        "x & 1",
        "x << 3",
        "x ^ 2",
        "~x",
        "x is x",
        "x in x",
        "await x",
        "yield x",
        "open(x)",
        "pow(x, 2)",
        "_power(x, 2)",
        "_power",
        "sin",
        "sin.x",
        "sin(*x)",
        "sin(x, **x)",
        "log(x, base=2)",
        "log(x, 2)",
        "hypot()",
        "sin()",
        "min(x)",
        "atan2(x)",
        "sin(x)(x)",
        "\x00",
        "x" * (1000 + 1),
        "-" * (1000 - 1) + "x",
        "(" * 400 + "x" + ")" * 400,
    ],
)
def test_nothing_but_arithmetic_is_allowed(text: str) -> None:
    with pytest.raises(ExpressionError, match=r"^f: "):
        Formulas(["x"], {}, {}, {"f": text})


@pytest.mark.parametrize("name", ["", "1a", "_a", "a__b", "a_", "lambda", "x", "sin", "pi", "a b", "a.b", "k", "é"])
def test_a_name_must_be_plain_and_new(name: str) -> None:
    for let, constants in (({name: "1"}, {"k": 1.0}), ({"k": "1"}, {name: 1.0})):
        with pytest.raises(ExpressionError):
            Formulas(["x"], constants, let, {})


@pytest.mark.parametrize(
    "text", ["9**9**9**9", "(x > 0)**(2**5000)", "floor(1e300)**floor(1e300)", "+".join(["x"] * 400)]
)
def test_no_expression_builds_a_huge_integer(text: str) -> None:
    with contextlib.suppress(OverflowError):
        assert isinstance(value(text, x=1.0), float)


def test_a_root_of_a_negative_number_is_no_complex_number() -> None:
    with pytest.raises(ValueError, match="domain"):
        value("x**0.5", x=-1.0)


class _Leaves:
    """An object that lets another thread run when it is freed, possibly in the middle of parsing."""

    def __init__(self) -> None:
        self.itself = self

    def __del__(self) -> None:
        time.sleep(0)


def test_threads_may_check_expressions_at_the_same_time() -> None:
    failed: list[BaseException] = []

    def check(text: str) -> None:
        try:
            for number in range(40):
                _Leaves()
                Formulas(["x"], {}, {}, {"f": text * 20 + str(number)}).function(["x"])
        except BaseException as error:  # noqa: BLE001 - a thread would only print it
            failed.append(error)

    before = gc.get_threshold()
    gc.set_threshold(10, 1, 1)
    try:
        threads = [threading.Thread(target=check, args=(text,)) for text in ("(x+1)*", "x-", "x*x*x+")]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        gc.set_threshold(*before)
    assert not failed
