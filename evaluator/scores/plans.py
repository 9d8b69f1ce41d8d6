"""Which parts of a text are plans: what the agent is about to do, where a number is a setting and no finding."""

import re
from collections.abc import Sequence
from typing import NamedTuple

_PLAN = re.compile(
    r"\b(?:(?:I|we)(?:['’]ll| will| am going to| are going to|['’](?:m|re) going to)|let me|let['’]s|let us"
    r"|(?:my|the) plan is|plan:|(?:as a )?next step[,:])",
    re.IGNORECASE,
)
_END = re.compile(r"[.!?;](?=\s|$)|\n|\b(?:because|since)\b", re.IGNORECASE)


class PlannedText(NamedTuple):
    """A part of a text, from its first character to the one after its last."""

    start: int
    end: int


def plans_in(text: str) -> list[PlannedText]:
    """The plans of a text: from the words that announce one to the end of the sentence or to a reason for it."""
    found: list[PlannedText] = []
    for announced in _PLAN.finditer(text):
        if found and announced.start() < found[-1].end:
            continue
        end = _END.search(text, announced.end())
        found.append(PlannedText(announced.start(), len(text) if end is None else end.start()))
    return found


def is_planned(plans: Sequence[PlannedText], position: int) -> bool:
    """Whether a character belongs to a plan."""
    return any(plan.start <= position < plan.end for plan in plans)
