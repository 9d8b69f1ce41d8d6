"""Generalisability: how much of a difference between two takers is luck, and which episodes to add against it. Pure.

On the answers 0 and 1 of the cells that all takers played: variance components of taker × scene, of taker × variant and
of the epochs, by the mean squares of the design (Brennan 2001, Generalizability Theory, ch. 3).
"""

from typing import NamedTuple

import numpy as np

from evaluator.calibration.responses import Responses

DETECTED = 1.959964 + 0.841621
"""Standard errors of a difference that a two-sided test at 5 % finds with 80 % certainty."""


class VarianceComponents(NamedTuple):
    """Variance components of the accuracy of a taker, and the design in which they were found."""

    taker_scene: float
    """Takers find different scenes hard."""
    taker_variant: float
    """They find different variants of a scene hard, and luck, where there is one epoch; 0 where there is one seed."""
    epoch: float
    """The same taker answers the same variant differently."""
    scenes: int
    seeds: int
    epochs: int

    def smallest_difference(self, scenes: int, seeds: int, epochs: int) -> float:
        """Smallest difference of two accuracies that a test finds with 80 % certainty in a design.

        Args:
            scenes: Scenes that both play.
            seeds: Seeds of each scene.
            epochs: Epochs of each seed.
        """
        variance = self.taker_scene / scenes + self.taker_variant / (scenes * seeds)
        return DETECTED * (2 * (variance + self.epoch / (scenes * seeds * epochs))) ** 0.5


def components(data: Responses) -> VarianceComponents | None:
    """The components; None unless all takers share two scenes with equally many seeds each.

    Args:
        data: The answers.
    """
    played = np.bincount(data.variant, minlength=len(data.variants))
    common = [place for place in range(len(data.variants)) if played[place] == len(data.takers)]
    by_scene: dict[int, list[int]] = {}
    for place in common:
        by_scene.setdefault(data.variants[place][0], []).append(place)
    if len(by_scene) < 2:
        return None
    seeds = min(map(len, by_scene.values()))
    order = [place for places in by_scene.values() for place in places[:seeds]]
    share, count = (np.zeros((len(data.takers), len(data.variants))) for _ in range(2))
    share[data.taker, data.variant] = data.right / data.answers
    count[data.taker, data.variant] = data.answers
    share, count = share[:, order], count[:, order]
    epochs = int(count.min())
    within = float((share * (1 - share) * count / np.maximum(count - 1, 1))[count > 1].mean()) if epochs > 1 else 0.0
    rest = share - share.mean(axis=1, keepdims=True) - share.mean(axis=0, keepdims=True) + share.mean()
    scenes, takers = len(by_scene), len(data.takers)
    of_scene = rest.reshape(takers, scenes, seeds).mean(axis=2)
    between = seeds * float((of_scene**2).sum()) / ((takers - 1) * (scenes - 1))
    if seeds == 1:
        return VarianceComponents(max(0.0, between - within / epochs), 0.0, within, scenes, seeds, epochs)
    left = rest.reshape(takers, scenes, seeds) - of_scene[:, :, None]
    inner = float((left**2).sum()) / ((takers - 1) * scenes * (seeds - 1))
    of_variant = max(0.0, inner - within / epochs)
    return VarianceComponents(max(0.0, (between - inner) / seeds), of_variant, within, scenes, seeds, epochs)
