"""Compares formulas by their values, at the same points for every answer of a scene."""

import functools

from evaluator.answers.formula import parse_formula, points_of, value_of
from evaluator.answers.symbolic import are_identical
from physment_mcp.contract.expressions import ExpressionError, Node
from scenes.answer_spec import AnswerSpec, Variable

ROUNDING = 1e-9
"""Relative difference that two ways of writing one formula may have, by rounding alone."""


def check_key(key: str, variables: dict[str, Variable]) -> None:
    """Refuse a key that cannot be compared with.

    Raises:
        ValueError: The key is no formula in these variables, or has no value somewhere in their ranges.
    """
    if not variables:
        raise ValueError("a formula needs variables")
    formula = parse_formula(key, variables)
    for point in points_of(variables):
        if value_of(formula, point) is None:
            raise ValueError(f"the key {key!r} has no value at {_written(point)}")


def compare_formulas(answer: str, key: str, spec: AnswerSpec, *, run_together: bool = False) -> tuple[bool, str]:
    """Whether a formula is within the tolerance of the key everywhere in the ranges of the variables, and why.

    At each point |answer - key| <= abs_tol + rel_tol |key|, with at least 1e-9 |key| for rounding. `run_together` is
    that of `parse_formula`.
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
    """Whether algebra shows that they are the same; asked only of formulas with the same values."""
    return first == second or bool(are_identical(first, second))


def _written(point: dict[str, float]) -> str:
    return ", ".join(f"{name} = {value:.4g}" for name, value in point.items())
