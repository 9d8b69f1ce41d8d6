"""Credit for intermediate quantities that an agent states beside its answer. Never part of a verdict."""

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

from evaluator.answers.forms import as_item, plain_number
from evaluator.answers.strict import allowed_distance
from evaluator.records.episode import Episode, Outcome

REL_TOL = 0.05
"""Relative tolerance of every step."""


def stated_steps(episode: Episode) -> Mapping[str, Any]:
    """What the accepted answer states in `steps`, verbatim; empty if it states nothing, or if there is no answer."""
    if episode.outcome is not Outcome.ANSWERED:
        return {}
    accepted = (
        exchange.call
        for turn in episode.turns
        for exchange in turn.exchanges
        if exchange.call.tool == "answer" and exchange.returned and not exchange.is_error
    )
    call = next(accepted, None)
    return {} if call is None else call.arguments.get("steps") or {}


def grade_steps(episode: Episode, values: Mapping[str, float]) -> dict[str, bool] | None:
    """Whether each quantity that the scene names is stated and within 5 % of its value.

    Args:
        episode: As recorded.
        values: The quantities that the scene names, with their values.

    Returns:
        None if the scene names none, or if the episode says nothing about the agent.
    """
    if not values or episode.outcome is Outcome.INFRASTRUCTURE_ERROR:
        return None
    stated = stated_steps(episode)
    return {name: _is_right(stated.get(name), value) for name, value in values.items()}


def _is_right(stated: Any, value: float) -> bool:
    item = as_item(stated)
    number = None if item is None else plain_number(item)
    wanted = Fraction(repr(value))
    return number is not None and abs(number.value - wanted) <= allowed_distance(wanted, REL_TOL, 0.0)
