"""Whether two formulas are the same by algebra, with SymPy, which is optional: `pip install physment-mcp[formula]`.

A remark beside the verdict, which the values alone decide, so that verdicts are the same with and without SymPy. The
algebra runs in a process of its own with a time limit, because simplifying an unlucky formula may take for ever.
"""

import importlib
import importlib.util
import json
import operator
import subprocess
import sys
from collections.abc import Sequence
from typing import Any

from physment_mcp.contract.expressions import Node

LIMIT_S = 10.0
"""Wall time for one comparison [s]."""


def are_identical(first: Node, second: Node, limit_s: float = LIMIT_S) -> bool | None:
    """Whether two formulas are equal for all values; None without SymPy, or if it does not find out in time."""
    if importlib.util.find_spec("sympy") is None:
        return None
    try:
        ended = subprocess.run(  # noqa: S603 - this module, which reads a tree and runs no text
            [sys.executable, "-m", __name__],
            input=json.dumps([first, second]),
            capture_output=True,
            text=True,
            timeout=limit_s,
            check=True,
        )
    except (subprocess.TimeoutExpired, subprocess.CalledProcessError):
        return None
    return json.loads(ended.stdout)


def _main() -> None:
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
    """What SymPy calls a function."""
    return {"ln": "log", "abs": "Abs"}.get(head, head)


if __name__ == "__main__":
    _main()
