"""Scores as text for people: shares, dimensions, and what a budget curve shows."""

from evaluator.statistics.budget_curve import BudgetCurve, CurveShape


def curve_sentence(curve: BudgetCurve) -> str:
    """One sentence: the shape of a budget curve, the budget after which gains end, and the certainty of both."""
    budgets = [point.budget for point in curve.points]
    on = f"{curve.n} episodes of {curve.n_scenes} scenes at each budget"
    if curve.shape is CurveShape.FLAT:
        sure = (
            ""
            if curve.certainty is None
            else f"; within {100 * curve.margin:g} points with {_certain(curve.certainty)}"
        )
        shape = f"no two budgets can be told apart on {on}{sure}"
    else:
        shape = f"accuracy is {curve.shape.value} with the budget on {on}, with {_certain(curve.certainty)}"
    if curve.enough == budgets[-1]:
        return f"{shape}; gains have not ended at {curve.enough}"
    sure = "" if curve.enough_certainty is None else f", with {_certain(curve.enough_certainty)}"
    return f"{shape}; beyond {curve.enough} no budget gains more than {100 * curve.margin:g} points{sure}"


def _certain(value: float | None) -> str:
    """A certainty in whole per cent, rounded down and at most 99 %."""
    return f"{min(99, int(100 * (value or 0.0)))} % certainty"


def share(value: float | None) -> str:
    """A share in per cent; a dash if it is undefined."""
    return "–" if value is None else f"{100 * value:.1f} %"


def decimal(value: float | None) -> str:
    """A dimension with three decimals; a dash if it is undefined."""
    return "–" if value is None else f"{value:.3f}"
