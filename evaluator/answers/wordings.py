"""Whether an answer in words says what the key says, by the wordings that a pack gives for it. Knows no verdicts."""

import functools
import re
from collections.abc import Sequence

from scenes.answer_spec import AnswerSpec, Wording

MAX_CHARS = 300
"""Longer answers are not searched: expressions may be slow on long text, and a wording is one sentence."""
_NEGATED = re.compile(r"\b(ca|wo)n't\b|n't\b|\bcannot\b")
_STEMS = {"ca": "can", "wo": "will"}


def expressions_of(spec: AnswerSpec) -> list[str]:
    """All expressions of all wordings."""
    wordings = [wording for several in spec.wordings.values() for wording in several]
    return [expression for wording in wordings for expression in (*wording.says, *wording.never)]


def first_wording(text: str, wordings: Sequence[Wording]) -> str | None:
    """The expression by which the first fitting wording is recognised; None if no wording fits.

    Raises:
        re.error: An expression cannot be read.
    """
    plain = _plain(text)
    if not 0 < len(plain) <= MAX_CHARS:
        return None
    for wording in wordings:
        said = next((says for says in wording.says if _compiled(says).search(plain)), None)
        if said is not None and not any(_compiled(never).search(plain) for never in wording.never):
            return said
    return None


def _plain(text: str) -> str:
    """The text in lower case with single spaces, straight apostrophes, and negations written out."""
    straight = " ".join(text.lower().replace("’", "'").split())
    return _NEGATED.sub(_written_out, straight)


def _written_out(found: re.Match[str]) -> str:
    if found[0] == "cannot":
        return "can not"
    return f"{_STEMS[found[1]]} not" if found[1] else " not"


@functools.cache
def _compiled(expression: str) -> re.Pattern[str]:
    return re.compile(expression)
