"""Results printed in the paper, shown beside ours for context. They were measured on other scenes than ours."""

from typing import NamedTuple

BUDGETS = (5, 10, 15, 20)


class Quoted(NamedTuple):
    """The overall accuracy of a model, as printed in the paper."""

    model: str
    accuracy: tuple[float, ...]
    """In per cent, in the order of `BUDGETS`."""


PAPER = (
    Quoted("GPT-5.5", (51.4, 49.5, 48.6, 50.5)),
    Quoted("Claude Opus 4.7", (40.5, 39.6, 42.3, 40.5)),
    Quoted("DeepSeek R1", (42.3, 51.4, 48.6, 53.3)),
    Quoted("GLM-5", (46.7, 37.7, 48.6, 48.6)),
    Quoted("Kimi K2.5", (27.4, 37.1, 46.7, 56.2)),
    Quoted("Qwen 3.5", (26.7, 24.8, 35.2, 27.6)),
    Quoted("Gemini 3.1 Pro", (29.5, 50.4, 51.4, 66.7)),
)
"""Overall accuracy by iteration budget [%], after the authors re-graded by rules of their own."""
