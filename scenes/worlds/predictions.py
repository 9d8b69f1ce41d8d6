"""Predicts the answers to a world's questions from pushes and readings, with their uncertainty.

The search of `scenes.worlds.search` finds structures. The best ones are fitted to all legs in sequence and weighted by
their evidence, and each predicts with samples of the constants that the readings allow. If no structure explains the
readings, the variances of the readings are multiplied by the reduced chi-square of the best one.

Source: R. T. Birge, The calculation of errors by the method of least squares, Phys. Rev. 40, 207 (1932).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from scenes.fitting import Array
from scenes.worlds.answering import answers
from scenes.worlds.candidates import Fit
from scenes.worlds.course_fits import on_course
from scenes.worlds.questions import Question, tolerance
from scenes.worlds.refits import constants_of
from scenes.worlds.search import Search
from scenes.worlds.terms import Structure
from scenes.worlds.weak_form import named

EXPLAINED = 1.7
"""Largest reduced chi-square for which the reference reports that it knows the law."""
_KEPT, _BEHIND = 6, 20.0
"""Largest number of structures that are fitted to the whole course, and limit of their scores above the best score."""
_DRAWS = 120
"""Number of predictions of each structure."""
_STEP_S = 0.04


@dataclass(frozen=True)
class Prediction:
    """The reference agent's answers to the questions of a world, with their uncertainty."""

    answer: Array
    """The answers: for each question the prediction whose tolerance contains the most other predictions."""
    low: Array
    """2.5th percentile of the predictions."""
    high: Array
    """97.5th percentile."""
    reduced: float
    """Reduced chi-square of the best-fitting structure."""
    structures: dict[Structure, float]
    """Structure → its weight in the predictions."""
    tried: int
    """Number of structures that were fitted."""
    law: tuple[Structure, dict[str, float]]
    """The best structure, with its constants."""

    def says(self) -> str:
        """Describe the prediction and its uncertainty in words."""
        found = max(self.structures, key=lambda structure: self.structures[structure])
        numbers = ", ".join(
            f"{a:.4g} ({b:.3g} to {c:.3g})" for a, b, c in zip(self.answer, self.low, self.high, strict=True)
        )
        doubt = (
            "It explains the readings."
            if self.known
            else "It does not explain the readings, so the answers are a guess."
        )
        return (
            f"The most likely law of {self.tried} fits is {found.label}, with a weight of {self.structures[found]:.2f}"
            f" among {len(self.structures)}, and a chi-square of {self.reduced:.2f} for each degree of freedom. {doubt}"
            f" Answers with 95 % intervals: {numbers}."
        )

    @property
    def known(self) -> bool:
        """Whether the best structure explains the readings."""
        return self.reduced <= EXPLAINED


def predicted(search: Search, asked: Sequence[Question]) -> Prediction:
    """Run a search for structures, and predict the answers from its best fits.

    Args:
        search: A search that has not been run yet.
        asked: The questions.
    """
    with np.errstate(all="ignore"):
        return weighed(search, search.run(), asked)


def weighed(search: Search, best: Sequence[Fit], asked: Sequence[Question]) -> Prediction:
    """Predict from the fits of a search, in order of evidence.

    Args:
        search: The search that made the fits.
        best: The fits.
        asked: The questions.
    """
    with np.errstate(all="ignore"):
        kept = [fit for fit in best[:_KEPT] if fit.score < best[0].score + _BEHIND]
        fits = [on_course(search.legs.course, search.legs.told, fit) for fit in kept]
    fits.sort(key=lambda fit: fit.score)
    reduced = fits[0].chi_square / max(search.legs.course.count - len(fits[0].unit), 1)
    variance = reduced if reduced > EXPLAINED else 1.0
    weights = np.exp(-0.5 * np.array([fit.score - fits[0].score for fit in fits]) / variance)
    drawn = [plausible(fit, asked, _DRAWS, variance) for fit in fits]
    share = np.concatenate([np.full(one.shape[1], weight) for one, weight in zip(drawn, weights, strict=True)])
    found, share = np.hstack(drawn), share / share.sum()
    best_answers = drawn[0][:, 0]
    return Prediction(
        np.array([_likeliest(row, share, at) for row, at in zip(found, best_answers, strict=True)]),
        np.array([_quantile(row, share, 0.025) for row in found]),
        np.array([_quantile(row, share, 0.975) for row in found]),
        reduced,
        dict(zip((fit.structure for fit in fits), (float(w) for w in weights / weights.sum()), strict=True)),
        search.tried,
        (fits[0].structure, constants_of(fits[0])),
    )


def _quantile(found: Array, share: Array, level: float) -> float:
    """Quantile of the weighted predictions."""
    order = np.argsort(found)
    at = int((np.cumsum(share[order]) < level).sum())
    return float(found[order[min(at, len(order) - 1)]])


def _likeliest(found: Array, share: Array, first: float) -> float:
    """Return the prediction within whose tolerance most others lie; `first` unless that one is clearly better."""
    values = np.where(np.isfinite(found), found, 1e9)
    near = np.abs(values[:, None] - values) <= tolerance(values)
    mass = near @ share
    best, own = int(np.argmax(mass)), float(share[np.abs(values - first) <= tolerance(np.array(first))].sum())
    return float(values[best]) if mass[best] > own + 0.1 else float(first)


def plausible(fit: Fit, asked: Sequence[Question], count: int, variance: float = 1.0) -> Array:
    """Return answers for the best constants, then for samples that the readings allow.

    Args:
        fit: A fit to all legs in sequence.
        asked: The questions.
        count: Number of samples.
        variance: Variance of the readings, relative to that of their noise.

    Returns:
        Shape (questions, 1 + count).
    """
    normal = fit.slope.T @ fit.slope / variance + np.eye(len(fit.unit))
    values, axes = np.linalg.eigh(normal)
    drawn = np.random.default_rng(0).standard_normal((count, len(values))) / np.sqrt(np.maximum(values, 1e-9)) @ axes.T
    units = np.column_stack([fit.unit[:, None], np.clip(fit.unit + drawn, -0.1, 1.1).T])
    with np.errstate(all="ignore"):
        found = answers(fit.structure, named(fit.structure, units), asked, _STEP_S)
    return np.where(np.isfinite(found), np.clip(found, -1e6, 1e6), 1e6)
