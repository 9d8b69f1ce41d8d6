"""Formats scores as text: shares, dimensions with their sample size, blind-guess scores, and budget curves."""

from collections.abc import Mapping

from evaluator.scores.metrics import ConditionAbility, GroupSummary
from evaluator.statistics.paired import BudgetCurve, CurveShape


def curve_sentence(curve: BudgetCurve) -> str:
    """Describe in one sentence the shape of a budget curve, the budget after which gains end, and their certainty."""
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


def ability_sentence(found: ConditionAbility) -> str:
    """Describe the ability of an agent in an adaptive test in one sentence."""
    one, ends = found.estimate, found.estimate.interval
    return (
        f"{found.agent}, budget {found.budget}: ability {one.ability:.2f} ± {one.se:.2f} logits, 95 % interval"
        f" {ends.low:.2f} to {ends.high:.2f}, from {one.answers} episodes that an adaptive test chose; their accuracy"
        " compares with no other"
    )


def _certain(value: float | None) -> str:
    """Format a certainty in whole per cent, rounded down and at most 99 %."""
    return f"{min(99, int(100 * (value or 0.0)))} % certainty"


def share(value: float | None) -> str:
    """Format a share in per cent; a dash if it is undefined."""
    return "–" if value is None else f"{100 * value:.1f} %"


def decimal(value: float | None) -> str:
    """Format a dimension with three decimals; a dash if it is undefined."""
    return "–" if value is None else f"{value:.3f}"


def score_text(value: float | None) -> str:
    """Format a score from 0 to 100 with one decimal; a dash if it is undefined."""
    return "–" if value is None else f"{value:.1f}"


def withdrawn_clause(group: GroupSummary) -> str:
    """State the number of withdrawn episodes of a group and the bounds of its accuracy; empty if there are none."""
    bounds = group.accuracy_bounds
    if bounds is None:
        return ""
    return (
        f"{group.n_withdrawn} withdrawn: {share(bounds.all_wrong)} if all of these were wrong,"
        f" {share(bounds.all_right)} if all were right"
    )


def counted(group: GroupSummary, name: str) -> str:
    """Describe the sample of a group's dimension; empty if every scored episode defines it.

    Args:
        group: The group.
        name: Field name of the dimension.
    """
    return counted_of(name, group.n_defined, group.n_numbers, group.n_scored)


def counted_of(name: str, n_defined: Mapping[str, int], n_numbers: int, n_scored: int) -> str:
    """Describe the sample of a dimension, given its counts; see `counted`.

    Args:
        name: Field name of the dimension.
        n_defined: Field name → number of scored episodes that define it.
        n_numbers: Number of numbers that the reasoning states.
        n_scored: Number of scored episodes.
    """
    if name in {"g", "g_plus"}:
        return f"{n_numbers} number{'' if n_numbers == 1 else 's'} in {n_defined[name]} of {n_scored} episodes"
    return "" if n_defined[name] == n_scored else f"defined in {n_defined[name]} of {n_scored} episodes"


def dimension(group: GroupSummary, name: str) -> str:
    """Format a dimension of a group with three decimals and its sample."""
    note = counted(group, name)
    return decimal(getattr(group, name)) + (f" ({note})" if note else "")


def floor_sentence(groups: Mapping[str, GroupSummary]) -> str:
    """State the Final Score of an agent that never experiments; empty if no agent has a Final Score.

    Args:
        groups: Agent → summary of its episodes.
    """
    found = {name: group.blind_score for name, group in groups.items() if group.final_score is not None}
    scores = [f"{score:.1f}" for score in found.values() if score is not None]
    if not scores:
        return ""
    beside = f"{scores[0]} on the same scenes, seeds and budgets"
    if len(set(scores)) > 1:
        beside = ", ".join(f"{score} beside {name}" for name, score in zip(found, scores, strict=True))
    return f"an agent that never experiments gets a Final Score of {beside}"
