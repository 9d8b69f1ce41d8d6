"""Estimates the ability of a test taker by the Rasch model, from answers to scenes of known difficulty.

    logit P(right) = ability - difficulty(scene) - deviation(scene:seed)

The ability has a wide normal prior. Difficulties are known up to their standard errors, and deviations up to their
standard deviation; both are integrated out. The posterior is computed on a grid. The module also computes the Fisher
information of further answers.
"""

import functools
import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from evaluator.records.episode import Choice, Record
from evaluator.statistics.intervals import Array, Interval

ABILITY_SD = 3.0
"""Prior standard deviation of abilities [logits]."""
_ABILITIES = np.linspace(-12.0, 12.0, 161)
"""Grid of abilities [logits]."""
_RESTS, _DEVIATIONS, _REACH = 11, 9, 4.0
"""Number of grid points for the error of a difficulty and for the deviation of a variant; half-width of normal grids
[standard deviations]."""


class SceneDifficulty(NamedTuple):
    """Estimated difficulty of a scene [logits]."""

    logits: float
    se: float
    """Its standard error."""
    variant_sd: float
    """Standard deviation of variants around their scene."""


class Ability(Record):
    """The ability of a taker [logits]."""

    ability: float
    """Posterior mean."""
    se: float
    """Posterior standard deviation."""
    interval: Interval
    """Central 95 % of the posterior."""
    answers: int
    """Number of answers that it was estimated from."""


Answers = Mapping[int, tuple[int, int]]
"""Seed → number of right answers and number of answers, in one scene."""


@functools.cache
def normal_grid(points: int) -> tuple[Array, Array]:
    """Return equally spaced points of the standard normal distribution, and the logarithms of their weights."""
    at = np.linspace(-_REACH, _REACH, points) if points > 1 else np.zeros(1)
    weight = np.exp(-(at**2) / 2)
    return at, np.log(weight / weight.sum())


def scene_likelihood(difficulty: SceneDifficulty, answers: Answers) -> Array:
    """Return the logarithm of the likelihood of the answers in one scene, at each ability of the grid."""
    if len(answers) == 1:
        # With a single variant, the sum of the error and the deviation is one normal variable.
        difficulty = SceneDifficulty(difficulty.logits, 0.0, math.hypot(difficulty.se, difficulty.variant_sd))
    rests, rest_weights = normal_grid(_RESTS if difficulty.se else 1)
    deviations, deviation_weights = normal_grid(_DEVIATIONS if difficulty.variant_sd else 1)
    shift = difficulty.se * rests[:, None] + difficulty.variant_sd * deviations
    logits = _ABILITIES - difficulty.logits - shift[:, :, None]
    right, wrong = -np.logaddexp(0, -logits), -np.logaddexp(0, logits)
    of_scene = rest_weights[:, None]
    for successes, count in answers.values():
        of_variant = deviation_weights[:, None] + successes * right + (count - successes) * wrong
        of_scene = of_scene + np.logaddexp.reduce(of_variant, axis=1)
    return np.logaddexp.reduce(of_scene, axis=0)


def posterior_ability(likelihoods: Iterable[Array], answers: int) -> Ability:
    """Estimate an ability.

    Args:
        likelihoods: Result of `scene_likelihood` for each scene that was answered.
        answers: Number of answers.
    """
    logarithm = sum(likelihoods, -((_ABILITIES / ABILITY_SD) ** 2) / 2)
    weight = np.exp(logarithm - logarithm.max())
    weight /= weight.sum()
    mean = float(weight @ _ABILITIES)
    below = np.cumsum(weight) - weight / 2
    low, high = (float(np.interp(share, below, _ABILITIES)) for share in (0.025, 0.975))
    se = float(weight @ (_ABILITIES - mean) ** 2) ** 0.5
    return Ability(ability=mean, se=se, interval=Interval(low=low, high=high), answers=answers)


def ability_of(chosen: Sequence[tuple[int, int, Choice, bool]]) -> Ability:
    """Estimate the ability of a taker in an adaptive test.

    Args:
        chosen: For each scored episode its scene, its seed, the record of its choice, and whether its answer is right.
    """
    difficulties: dict[int, SceneDifficulty] = {}
    counts: defaultdict[int, dict[int, tuple[int, int]]] = defaultdict(dict)
    for scene, seed, choice, is_right in chosen:
        difficulties[scene] = SceneDifficulty(choice.difficulty, choice.difficulty_se, choice.variant_sd)
        right, answers = counts[scene].get(seed, (0, 0))
        counts[scene][seed] = (right + is_right, answers + 1)
    return posterior_ability(
        (scene_likelihood(difficulties[scene], found) for scene, found in counts.items()), len(chosen)
    )


def information(difficulties: Sequence[SceneDifficulty], answers: Sequence[int], ability: float) -> Array:
    """Return the Fisher information about an ability that one more answer in each scene gives [1/logit²].

    All answers in a scene share the error of its difficulty, so each further answer gives less information.

    Args:
        difficulties: The difficulty of each scene.
        answers: Number of answers of the taker in each scene so far.
        ability: The present estimate.
    """
    logits, se, variant_sd = np.array(difficulties, dtype=float).reshape(-1, 3).T
    deviations, weights = normal_grid(_DEVIATIONS)
    chance = 1 / (1 + np.exp(logits[:, None] + variant_sd[:, None] * deviations - ability))
    mean, slope = chance @ np.exp(weights), (chance * (1 - chance)) @ np.exp(weights)
    each, before = slope**2 / (mean * (1 - mean)), np.asarray(answers, dtype=float)

    def total(count: Array) -> Array:
        return count * each / (1 + count * each * se**2)

    return total(before + 1) - total(before)
