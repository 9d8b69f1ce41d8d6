"""Tests of generated code that computes each common subexpression once."""

import math

import pytest

from scenes.worlds.straight_line import Program

CONSTANTS, STATE = {"a": 0.7, "n": 1.3}, {"t": 2.0, "x": 0.6, "y": -1.1}
EXPRESSIONS = (
    "sqrt(x**2+y**2+0.01)", "-a*sqrt(x**2+y**2+0.01)**(n-1)*x", "x**3-y**4", "(0.5+0.5*sin(2*pi*t/a))**4", "x**-2",
    "a*x-(-y)", "1-(x-(y-t))", "x/(y/t)", "x**n**2", "-x**2",
)  # fmt: skip


def computed(program: Program, text: str) -> float:
    """Run the lines of a program, and return the value of an expression."""
    value = program.value(text)
    scope: dict[str, object] = {"sqrt": math.sqrt, "sin": math.sin, "pi": math.pi, **CONSTANTS, **STATE}
    exec("\n".join([*program.early, *program.late, f"found={value}"]), scope)
    found = scope["found"]
    assert isinstance(found, float)
    return found


@pytest.mark.parametrize("text", EXPRESSIONS)
def test_an_expression_keeps_its_value(text: str) -> None:
    scope = {"sqrt": math.sqrt, "sin": math.sin, "pi": math.pi, **CONSTANTS, **STATE}
    wanted = eval(text, scope)
    assert computed(Program(STATE), text) == pytest.approx(wanted, rel=1e-14)


def test_an_operation_is_written_once_and_constants_come_first() -> None:
    program = Program(STATE)
    program.let("r", "sqrt(x**2+y**2)")
    value = program.value("sqrt(x**2+y**2)*cos(a)+r*sin(2*pi*a)")
    assert program.early == ["v4=cos(a)", "v6=2*pi", "v7=v6*a", "v8=sin(v7)"]
    assert program.late == ["v0=x*x", "v1=y*y", "v2=v0+v1", "v3=sqrt(v2)", "v5=v3*v4", "v9=v3*v8", "v10=v5+v9"]
    assert value == "v10"


def test_what_is_no_expression_is_refused() -> None:
    with pytest.raises(ValueError, match="no expression of the grammar"):
        Program(STATE).value("x if y else t")
