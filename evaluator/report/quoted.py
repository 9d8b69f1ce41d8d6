"""Results printed in the paper, shown beside ours for context. They were measured on other scenes than ours."""

from typing import NamedTuple

BUDGETS = (5, 10, 15, 20)
CATEGORIES = {
    "easy-single": "Easy Single Phys.",
    "easy-single-creation": "Easy Single + Obj.C.",
    "easy-single-hidden": "Easy Single + Hid.",
    "hard-single": "Hard Single Phys.",
    "hard-single-creation": "Hard Single + Obj.C.",
    "hard-single-hidden": "Hard Single + Hid.",
    "easy-multi": "Easy Multi",
    "easy-multi-creation": "Easy Multi + Obj.C.",
    "easy-multi-hidden": "Easy Multi + Hid.",
    "hard-multi": "Hard Multi",
    "hard-multi-creation": "Hard Multi + Obj.C.",
    "hard-multi-hidden": "Hard Multi + Hid.",
    "create-delete-attach": "Create / Del. / Att.",
}
"""Our category → the paper's name of it, in the order of its heat map."""


class Quoted(NamedTuple):
    """The results of a model, as printed in the paper."""

    model: str
    accuracy: tuple[float, ...]
    """Overall, in per cent, in the order of `BUDGETS`."""
    mean_accuracy: float
    """Over all budgets, in per cent."""
    dimensions: tuple[float, ...]
    """C, E, G, V, R, G′."""
    final_score: float
    """0 to 100."""
    by_category: tuple[float, ...]
    """Accuracy in per cent over all budgets, in the order of `CATEGORIES`."""


PAPER = (
    Quoted(
        "GPT-5.5",
        (51.4, 49.5, 48.6, 50.5),
        50.0,
        (0.583, 0.537, 0.729, 1.000, 0.701, 0.476),
        64.1,
        (80.6, 50.0, 60.0, 36.7, 0.0, 40.0, 41.7, 40.0, 85.0, 66.7, 80.0, 60.0, 18.2),
    ),
    Quoted(
        "Claude Opus 4.7",
        (40.5, 39.6, 42.3, 40.5),
        40.7,
        (0.503, 0.655, 0.544, 0.999, 0.613, 0.580),
        60.0,
        (25.0, 45.0, 25.0, 25.0, 0.0, 30.0, 21.7, 65.0, 30.0, 71.7, 50.0, 100.0, 38.6),
    ),
    Quoted(
        "DeepSeek R1",
        (42.3, 51.4, 48.6, 53.3),
        48.5,
        (0.480, 0.418, 0.514, 1.000, 0.633, 0.588),
        55.4,
        (66.7, 40.0, 45.0, 6.7, 25.0, 40.0, 31.7, 25.0, 60.0, 31.7, 25.0, 25.0, 27.3),
    ),
    Quoted(
        "GLM-5",
        (46.7, 37.7, 48.6, 48.6),
        45.2,
        (0.351, 0.238, 0.744, 1.000, 0.700, 0.426),
        50.0,
        (61.1, 25.0, 45.0, 1.7, 20.0, 35.0, 25.0, 35.0, 50.0, 46.7, 30.0, 25.0, 18.2),
    ),
    Quoted(
        "Kimi K2.5",
        (27.4, 37.1, 46.7, 56.2),
        41.9,
        (0.308, 0.201, 0.702, 0.999, 0.708, 0.381),
        46.7,
        (50.0, 20.0, 30.0, 5.0, 30.0, 20.0, 30.0, 35.0, 55.0, 40.0, 25.0, 15.0, 25.0),
    ),
    Quoted(
        "Qwen 3.5",
        (26.7, 24.8, 35.2, 27.6),
        28.6,
        (0.224, 0.280, 0.712, 1.000, 0.678, 0.432),
        44.9,
        (33.3, 5.0, 20.0, 1.7, 30.0, 0.0, 5.0, 10.0, 25.0, 23.3, 10.0, 5.0, 13.6),
    ),
    Quoted(
        "Gemini 3.1 Pro",
        (29.5, 50.4, 51.4, 66.7),
        49.5,
        (0.555, 0.420, 0.598, 1.000, 0.657, 0.437),
        58.4,
        (72.2, 55.0, 50.0, 15.0, 50.0, 40.0, 45.0, 50.0, 80.0, 58.3, 70.0, 50.0, 56.8),
    ),
)
"""All models of the paper, after the authors re-graded by rules of their own."""

REGRADED = {
    "equivalent_object_notation": (15, 5),
    "trivial_rounding": (35, 10),
    "conceptual_description": (63, 11),
    "partial_answer_format": (37, 7),
}
"""Class of normalisation → re-graded cases and their scenes."""
