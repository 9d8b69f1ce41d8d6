"""Parses formulas that agents write, evaluates them, and compares their values with those of the key.

A formula consists of numbers, the variables of the scene, `pi`, the operators + - * / ^ (or **), brackets and the
functions below. Factors may be written side by side (`2 x`), except after a division, because `1/2 x` is ambiguous.
Everything is computed in floating point, so no power can become a huge integer.

The values alone decide the verdict, so verdicts are the same with and without SymPy. SymPy only adds the remark that
two formulas are identical. It runs in a child process with a time limit, because simplification may not terminate.
"""

import functools
import importlib
import importlib.util
import json
import math
import operator
import random
import re
import resource
import subprocess
import sys
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from evaluator.answers.forms import unlabel
from physment_mcp.contract.expressions import FUNCTIONS, ExpressionError, Language, Node, Token
from scenes import AnswerSpec
from scenes.answer_spec import Variable

MAX_CHARS = 300
"""Longest formula that is parsed."""
_POINTS = 64
_NAMES = {"sqrt", "exp", "log", "ln", "sin", "cos", "tan", "asin", "acos", "atan", "tanh", "abs"}
_FORMULAS = Language(
    signs=frozenset("+-*/^()") | {"**"},
    functions={name: FUNCTIONS[name] for name in FUNCTIONS if name in _NAMES},
    max_chars=6 * MAX_CHARS,  # `√` becomes ` sqrt `
    has_factors_side_by_side=True,
    unknown="{!r} is no variable of the scene",
)
_SIGNS = str.maketrans({"·": "*", "×": "*", "⋅": "*", "÷": "/", "−": "-", "–": "-", "π": " pi ", "√": " sqrt "})
_RAISED = re.compile(r"[⁺⁻]?[⁰¹²³⁴⁵⁶⁷⁸⁹]+")
_LOWERED = str.maketrans("⁰¹²³⁴⁵⁶⁷⁸⁹⁺⁻", "0123456789+-")
_LATEX = (
    (re.compile(r"\\(?:left|right)(?![a-z])|\\[()\[\]]"), ""),
    (re.compile(r"\\[,;: ]"), " "),
    (re.compile(r"\\(?:cdot|times)(?![a-z])"), "*"),
    (re.compile(r"\\(pi|sin|cos|tan|exp|ln|log)(?![a-z])"), r" \1 "),
    (re.compile(r"\\sqrt\s*\{([^{}]*)\}"), r" sqrt(\1)"),
    (re.compile(r"\^\s*\{([^{}]*)\}"), r"^(\1)"),
    (re.compile(r"_\s*\{(\w+)\}"), r"_\1"),
    (re.compile(r"\\[dt]?frac\s*\{([^{}]*)\}\s*\{([^{}]*)\}"), r" ((\1)/(\2))"),
)
_ARGUMENTS = re.compile(r"^([^\W\d]\w{0,12}) ?\([\w, ]*\) ?=")
"""The left side of `F(x, v) = 2 x v`."""


def one_side(text: str, variables: Collection[str]) -> str:
    """Return the right side of `F = 2 x` or `The answer is 2 x`, with common LaTeX converted to plain text.

    If the left side is a variable of the scene, the text is an equation and is returned whole.
    """
    text = text.strip().removesuffix(".")
    for mark in ("**", "`", "$$", "$"):
        if len(text) > 2 * len(mark) and text.startswith(mark) and text.endswith(mark):
            text = text[len(mark) : -len(mark)].strip()
    for command, meaning in _LATEX:
        text = command.sub(meaning, text)
    label, rest = unlabel(_ARGUMENTS.sub(r"\1 =", text))
    is_equation = "=" in rest or text.startswith("-") or label.lower() in {name.lower() for name in variables}
    return text if is_equation else rest


def parse_formula(text: str, variables: Collection[str], *, run_together: bool = False) -> Node:
    """Parse a formula.

    Args:
        text: The formula.
        variables: Names of the variables.
        run_together: Whether `xv` is read as `x v`, if `xv` is no variable and there is only one way to split it.

    Raises:
        ExpressionError: The text is not a formula, contains an unknown name, or is too long.
    """
    if len(text) > MAX_CHARS:
        raise ExpressionError(f"longer than {MAX_CHARS} characters")
    plain = _RAISED.sub(lambda found: f"^({found[0].translate(_LOWERED)})", text.translate(_SIGNS))
    return _FORMULAS.read(plain, variables, lambda tokens: _divided(tokens, variables) if run_together else tokens)


def _divided(tokens: Sequence[Token], variables: Collection[str]) -> list[Token]:
    """Split each unknown name into the variables of which it consists, if there is only one way."""
    found: list[Token] = []
    in_exponent = False
    for kind, text in tokens:
        # `2^xv` could mean 2^(x v) or (2^x) v, so a name in an exponent is not split.
        is_known = text in variables or text in _FORMULAS.functions or text == "pi" or in_exponent
        ways = [] if kind != "name" or is_known else _ways(text, {*variables, "pi"})
        found += [("name", part) for part in ways[0]] if len(ways) == 1 else [(kind, text)]
        in_exponent = text in {"^", "**"} or (in_exponent and text in {"+", "-"})
    return found


def _ways(text: str, names: Collection[str]) -> list[tuple[str, ...]]:
    """Split a text into a sequence of names; return at most two of the possible splits."""
    ways: list[list[tuple[str, ...]]] = [[()], *([] for _ in text)]
    for end in range(1, len(text) + 1):
        for name in names:
            start = end - len(name)
            if start >= 0 and text[start:end] == name:
                ways[end] = (ways[end] + [(*way, name) for way in ways[start]])[:2]
    return ways[-1]


def value_of(formula: Node, values: Mapping[str, float]) -> float | None:
    """Evaluate a formula; None if it has no finite real value at these values of the variables."""
    try:
        (value,) = _FORMULAS.compiled([*values], [formula])(*values.values())
    except (ArithmeticError, ValueError):
        return None
    return value if math.isfinite(value) else None


def points_of(variables: Mapping[str, Variable]) -> list[dict[str, float]]:
    """Return the fixed points at which formulas are compared: the lowest and highest corner, and uniform samples."""
    source = random.Random("formula")  # noqa: S311 - reproducible points, not a secret
    low, high = ({name: variable.range[end] for name, variable in variables.items()} for end in (0, 1))
    drawn = [
        {name: low[name] + (high[name] - low[name]) * source.random() for name in variables} for _ in range(_POINTS)
    ]
    return [low, high, *drawn]


LIMIT_S = 10
"""Limit on the processor time of one comparison [s]. A wall-time limit would make grades depend on other load."""
_WALL_S = 300.0
"""Wall time after which a comparison that used no processor time is abandoned [s]."""


def are_identical(first: Node, second: Node, limit_s: int = LIMIT_S) -> bool | None:
    """Whether two formulas are algebraically equal; None without SymPy, or if it reaches no result within the limit."""
    if importlib.util.find_spec("sympy") is None:
        return None
    try:
        ended = subprocess.run(  # noqa: S603 - runs this module, which parses a syntax tree and executes no text
            [sys.executable, "-m", __name__, str(limit_s)],
            input=json.dumps([first, second]),
            capture_output=True,
            text=True,
            timeout=_WALL_S,
            check=True,
        )
    except (subprocess.TimeoutExpired, subprocess.CalledProcessError):
        return None
    return json.loads(ended.stdout)


def _main() -> None:
    limit_s = int(sys.argv[1])
    resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s))
    sympy: Any = importlib.import_module("sympy")
    first, second = (_expression(tree, sympy) for tree in json.load(sys.stdin))
    sys.stdout.write(json.dumps(True if sympy.simplify(first - second) == 0 else None))


def _expression(tree: Sequence[Any], sympy: Any) -> Any:
    head, parts, text = tree
    if head == "number":
        return sympy.Rational(text)
    if head == "name":
        return sympy.pi if text == "pi" else sympy.Symbol(text, real=True)
    operands = [_expression(part, sympy) for part in parts]
    function: Any = getattr(operator, _OPERATORS[head]) if head in _OPERATORS else getattr(sympy, _function_name(head))
    return function(*operands)


_OPERATORS = {"+": "add", "-": "sub", "*": "mul", "/": "truediv", "**": "pow", "negative": "neg"}


def _function_name(head: str) -> str:
    """Return SymPy's name of a function."""
    return {"ln": "log", "abs": "Abs"}.get(head, head)


if __name__ == "__main__":
    _main()


ROUNDING = 1e-9
"""Largest relative difference between equal formulas that is attributed to rounding."""


def check_key(key: str, variables: dict[str, Variable]) -> None:
    """Check that answers can be compared with a key.

    Raises:
        ValueError: The key is not a formula in these variables, or is undefined somewhere in their ranges.
    """
    if not variables:
        raise ValueError("a formula needs variables")
    formula = parse_formula(key, variables)
    for point in points_of(variables):
        if value_of(formula, point) is None:
            raise ValueError(f"the key {key!r} has no value at {_written(point)}")


def compare_formulas(answer: str, key: str, spec: AnswerSpec, *, run_together: bool = False) -> tuple[bool, str]:
    """Whether a formula agrees with the key throughout the ranges of the variables, and the reason.

    At each point, |answer - key| <= abs_tol + max(rel_tol, 1e-9) |key|, where 1e-9 allows for rounding. For
    `run_together` see `parse_formula`.
    """
    try:
        formula = parse_formula(answer, spec.variables, run_together=run_together)
    except ExpressionError as error:
        return False, f"no formula: {error}"
    wanted = parse_formula(key, spec.variables)
    largest = 0.0
    for point in points_of(spec.variables):
        want, got = value_of(wanted, point), value_of(formula, point)
        assert want is not None, "check_key has computed it"
        if got is None:
            return False, f"the formula has no value at {_written(point)}"
        if abs(got - want) > spec.abs_tol + max(spec.rel_tol, ROUNDING) * abs(want):
            return False, f"{got:.6g} is too far from {want:.6g} at {_written(point)}"
        largest = max(largest, abs(got - want) / abs(want) if want else 0.0)
    if largest <= ROUNDING and _identical(formula, wanted):
        return True, "the formula is the key, by algebra"
    return True, f"within {largest:.2g} of the key at {len(points_of(spec.variables))} points"


@functools.lru_cache(maxsize=1000)
def _identical(first: Node, second: Node) -> bool:
    """Whether two formulas with the same values are algebraically equal."""
    return first == second or bool(are_identical(first, second))


def _written(point: dict[str, float]) -> str:
    return ", ".join(f"{name} = {value:.4g}" for name, value in point.items())
